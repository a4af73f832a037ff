"""The panoramic environment map: views of a narrow depth camera on one sphere, with range and sigma per pixel.

Read in this order. Building it: `views` (input: depth image, grey images, prior pose), `sphere` (the pixel
grid), `matches` (features of views, matched), `pairs` (relative pose of two views by features), `surfaces` (by
depth), `adjustment` (pose graph of all views), `rendering` (range, sigma and time stamp per pixel), `stitching` (all
steps in order). Reading it:
`key_angles` (head angles of the finished panorama), `level_sets` (segmentation by forward distance),
`contours` and `silhouettes` (distance and edges of an obstacle), `sizes` (distance, width and height with
their standard deviations), `hidden_corners` (how far an obstacle may extend behind what is seen of it),
`obstacles` (the result: obstacles and gaps from left to right) and `segments` (connected obstacles split at
discontinuities of their outline). `literal_formulas` holds the size formulas of seed 004 as they are printed.

Sources: seed 004, sections 2.2.2 and 2.3; Brown and Lowe 2007; Lewis 1995.
"""
