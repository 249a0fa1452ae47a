"""Studies: accuracy against cost, and stability where methods fail."""
