"""Co-simulation units (FMI 2.0) of rigid-body scenes: build, verify, demonstrate."""
