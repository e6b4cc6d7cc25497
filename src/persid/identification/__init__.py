"""From measurements to a model: a basis, Gram matrices, a regression, its validation."""
