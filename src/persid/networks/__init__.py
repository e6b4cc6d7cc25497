"""Claim L1: weighted l1 norms for sparse networks of many states."""
