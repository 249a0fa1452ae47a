"""The site: tours, the reference, and what Sphinx is told."""
