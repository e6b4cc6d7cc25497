"""The search: operating points, sector forms, the matrix inequality, the interior-point method."""
