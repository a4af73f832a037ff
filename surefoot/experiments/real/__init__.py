"""Studies on real recordings."""
