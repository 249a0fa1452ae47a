"""Tests of mechanics kernels."""
