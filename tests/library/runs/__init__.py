"""Tests of runs library."""
