"""The verdict on a model: the order of attempts, their outcomes, batches of models."""
