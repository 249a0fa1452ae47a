"""A body's motion near a state, as the linear system that controllers are designed for."""
