"""Tables and figures of Kang 2013: panoramas of range images and fuzzy obstacle avoidance."""
