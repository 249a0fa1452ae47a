"""The specification of each model, in one registry, and the question that a scene asks of them."""
