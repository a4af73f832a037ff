"""Tables and figures of seed 003."""
