"""Tests of numerics kernels."""
