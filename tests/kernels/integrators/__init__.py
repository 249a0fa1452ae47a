"""Tests of integrators kernels."""
