"""Depth images with a deviation per pixel, from each kind of sensor, and their points."""
