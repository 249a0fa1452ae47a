"""Tests of models kernels."""
