"""Tests of rotations kernels."""
