"""An independent checker for persid's certificates: exact arithmetic, from the file alone."""
