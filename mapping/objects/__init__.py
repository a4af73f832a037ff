"""Ground plans and boxes of what stands."""
