"""Bodies that walk: exact footsteps with drawn errors, or servos and soles."""
