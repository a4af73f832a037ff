"""Depth images with a standard deviation per pixel, from each kind of depth sensor.

Sensors: `time_of_flight` with `phase_unwrapping`, `structured_light`, `stereo` with `block_matching` and
`rectification`. `pixel_noise` is the noise that an image shows, `flying` finds false depth at edges, `distortion` is the
error that all points of a view share. Then `points` (back-projection), `reach` (range of depths used), `coverage` and
`health` (whether depth is reliable), `depth_to_colour` (registration of two cameras).

Sources: seed 003 for stereo, Kang et al. 2013 (seed 004) for time of flight.
"""
