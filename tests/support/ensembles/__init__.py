"""Ensembles that tests run, and kill."""
