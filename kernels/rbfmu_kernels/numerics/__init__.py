"""Numbers: elementary and elliptic functions, double-double arithmetic, scaling by powers of two."""
