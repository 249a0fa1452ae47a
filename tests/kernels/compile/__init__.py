"""Tests of compile kernels."""
