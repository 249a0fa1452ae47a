"""Where the results of an ensemble are kept, so that a stop of any kind loses little."""
