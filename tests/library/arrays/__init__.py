"""Tests of arrays library."""
