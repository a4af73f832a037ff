"""Tables and figures of seed 000."""
