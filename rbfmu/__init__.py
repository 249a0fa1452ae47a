"""One rigid body, done right."""
