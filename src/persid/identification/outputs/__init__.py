"""Models of systems of which only inputs and outputs are measured: starts, fits, choices."""
