"""Which model and which method serve a scene at the least cost."""
