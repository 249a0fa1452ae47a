"""Tests of native fmu."""
