"""Certificates of format 2, one theorem for all claims (docs/ledger.md is the specification)."""

FORMAT = "persid-certificate-2"
MAX_BYTES = 2**24
COMPANION = "companion"  # the field that names one, which a file may lack
