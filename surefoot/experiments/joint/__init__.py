"""Studies of the whole system: localisation, walking, gaze, planners, and the furnished home."""
