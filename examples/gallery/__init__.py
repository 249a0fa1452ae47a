"""Builds the gallery's page and pictures."""
