"""Planners: from a world model to the next footstep."""
