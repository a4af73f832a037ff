"""Faults of sensors, clock and feet, put between the simulated sensors and the stack.

`injection` has the settings, the names and the order; `pictures` what happens to cameras, `motion` what happens to
clock, odometry and gyro. The fault is in the frame that the stack receives, so a recording of the run contains it.
Source: ours.
"""
