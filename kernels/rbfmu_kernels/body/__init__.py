"""What models of a body share: their buffer, its state, loads and outputs, the body's principal axes."""
