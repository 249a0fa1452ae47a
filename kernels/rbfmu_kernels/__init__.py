"""Numba kernels of one rigid body: scalar functions on floats and tuples, callable from anyone's `@njit` code."""
