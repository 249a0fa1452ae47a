"""Identification: numbers of a scene, fitted to measured motion."""
