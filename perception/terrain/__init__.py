"""Terrain in layers: plane regions of several heights and inclinations, and the staircases among them.

Read in this order: `region` (plane, edges, covariance), `segmentation` (regions of one depth image), `distorted` (what the
distortion of the view does to each), `edges` (where a region ends, and why), `inclination` (level or ramp), `matching`
(numbers of treads and risers), `measurements` (the linear system), `staircase` (riser, tread, direction, first edge).

`floor` finds the one plane that the robot stands on; here the ground may have steps.

Sources: Poppinga et al. 2008, Feng, Taguchi and Kamat 2014, Proenca and Gao 2018 (growing planes); the rest ours.
"""
