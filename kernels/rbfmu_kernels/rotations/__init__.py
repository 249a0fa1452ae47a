"""Vectors and rotations: quaternions, matrices, Euler angles, rotation vectors."""
