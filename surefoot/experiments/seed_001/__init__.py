"""Tables and figures of seed 001."""
