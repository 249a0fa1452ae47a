"""Tests of studies library."""
