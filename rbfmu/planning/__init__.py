"""Planning: the model and the method that meet a scene's accuracy at the least cost."""
