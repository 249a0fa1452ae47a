"""Tests of planning library."""
