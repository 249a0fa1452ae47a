"""The numbers behind measured motion: a scene fitted to data."""
