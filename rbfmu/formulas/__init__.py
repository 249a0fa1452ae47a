"""Formulas as text: read, checked, and turned into a graph of operations."""
