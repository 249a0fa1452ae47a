"""What models of a body share: their buffer, its state, loads and outputs, and the body's principal axes."""
