"""Proofs as files: certificates, witnesses, obstructions, and the numbers read from them."""
