"""Motions that are known in closed form: uniform rotation, free rotation, plane pendulum."""
