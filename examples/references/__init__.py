"""Writes the 40-digit references of charts."""
