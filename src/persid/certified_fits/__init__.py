"""Certified fits."""
