"""The model as a value: its functions, its right side, simulation, exports."""
