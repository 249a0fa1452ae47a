"""One specification a model, in one registry, and the questions about a scene that the specifications ask."""
