"""Tests of exact kernels."""
