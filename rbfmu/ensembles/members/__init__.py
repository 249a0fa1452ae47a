"""The members of an ensemble: what is drawn for each, and what is applied."""
