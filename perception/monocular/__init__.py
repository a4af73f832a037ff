"""Perception with one camera, without a map: the floor by colour, obstacles by contact edges, their motion by flow.

Read in this order: `result` (data of one cycle), `back_projection` (pixels to floor points and back), `colour_range`
and `adaptation` (the colour model of the floor), `ground` (I_g), `components`, `edges` (contact edges I_E), `flow`
(corners tracked between pictures), `contact_covariance` (error propagation), `obstacles` (smallest flow, speed,
prediction), `movable` (I_r), `cycle` (all of these in order), `contact_detections` (discs for the tracker) and
`colour_floor` (what the pipeline calls).

Source: Han, Kim and Hong 2018 (seed 000), section 3.
"""
