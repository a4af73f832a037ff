"""Ground of several levels: the surfaces round the robot that a foot may stand on, fused from its depth images.

Read in this order: `surface` (values), `ground_map` (motion, images, surfaces), `measured` (what one region says),
`height_filter` (heights and slopes of all surfaces together), `sides` (straight sides), `seen_cells` and `outline` (the
rest of the outline), `lookup` (places in the image).

`perception.terrain` measures the regions of one image.

Source: ours.
"""
