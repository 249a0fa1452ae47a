"""Tests of fmu."""
