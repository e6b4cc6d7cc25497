"""Certificates of format 2, one theorem for all claims (docs/ledger.md is the specification)."""
