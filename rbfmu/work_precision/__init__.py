"""`rbfmu chart`: for accuracy X, use method Y, it costs Z."""
