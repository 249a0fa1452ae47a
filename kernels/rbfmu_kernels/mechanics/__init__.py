"""Kinematics, inertia, Newton-Euler equations and the equations of motion of one body."""
