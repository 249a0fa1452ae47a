"""FMUs for tests, importers of them, and wrong calls."""
