"""What speaks against a model: that it is not stable, or that a family has no certificate for it."""
