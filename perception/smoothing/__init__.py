"""Factor graphs of a whole walk or of its last seconds (GTSAM)."""
