"""Networks, by a weighted l1 norm: claim L1, and that no weights serve (docs/network-format.md)."""
