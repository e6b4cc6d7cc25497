"""Certificates of version 1, claims G, M, E and R: still checked, and closed; no claim is added here."""
