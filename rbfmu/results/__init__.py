"""What a run gave: its numbers, files, and tables of other libraries."""
