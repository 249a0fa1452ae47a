"""One module a model, be it of the whole body or of what a scene needs of it; see `body.shell`."""
