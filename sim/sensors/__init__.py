"""Simulated sensors.

`cameras` (colour and stereo images), `tof_camera` (ranges), and `geometric_sensor` (detections of discs without
rendering, for long studies).
"""
