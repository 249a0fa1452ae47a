"""What tests measure against: exact motions and formulas in many digits, and the cases that are hard."""
