"""Measurements as values: trajectories, readers, chunks of what is larger than memory."""
