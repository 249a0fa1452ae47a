"""Tests of the command as a user types it: what it says, how soon it starts, what it keeps, what it can do without."""
