"""Tests of scene library."""
