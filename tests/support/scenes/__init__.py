"""Scenes that tests need: made at random, in families, or wrong."""
