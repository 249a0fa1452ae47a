"""An independent integrator of one rigid body in quadruple precision, and errors measured by it."""
