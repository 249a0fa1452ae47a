"""One module a model: a co-simulation unit of the body, or of what of it a scene needs; see `body.shell`."""
