"""One camera, no map: where the floor is, and where it will be free after the next step.

Read in this order: `result` (what one cycle hands to the swarm), `colour_range` and `adaptation` (the colours
of the floor, and how they follow the light), `ground` (I_g), `edges` (where obstacles touch the floor),
`flow` (corners followed from picture to picture), `back_projection` (pixels to the floor and back),
`deviations` (how sure places on the floor are), `obstacles` (least flow, speed, prediction), `movable` (I_r),
`cycle` (all of it, in order).

Source: seed 000, section 3.
"""
