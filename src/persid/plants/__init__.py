"""What the measurements say about the distance of the plant from a certified model: estimates, never proofs."""
