"""Tables and figures of seed 004."""
