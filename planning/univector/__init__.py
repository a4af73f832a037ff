"""univector."""
