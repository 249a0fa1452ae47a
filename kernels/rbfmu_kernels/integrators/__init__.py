"""Methods that integrate the equations of motion over a communication step."""
