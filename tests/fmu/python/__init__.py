"""Tests of python fmu."""
