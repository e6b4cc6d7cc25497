"""Properties of functions proved by search, for files that carry no partition."""
