"""Fits under the condition that a certificate exists, and how sure a fit is."""
