"""One module a model: the layout of its buffer, `initialize`, `step`, `outputs`."""
