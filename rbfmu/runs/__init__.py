"""Runs of a model: its buffer filled with a scene's numbers, time grid, trajectories, errors."""
