"""Studies of the whole system."""
