"""gaze."""
