"""The FMU against a model of all its answers, by random calls."""
