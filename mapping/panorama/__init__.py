"""The panoramic environment map: views of a narrow depth camera on one sphere, range and sigma per pixel.

Read `views` (what goes in), `sphere` (what it is drawn on), `pairs` and `surfaces` (how one view lies to
another, by features and by depth), `adjustment` (all views at once), `rendering` (range, sigma and age per
pixel), `stitching` (the whole, in order). `key_angles` finds the views' own directions in the finished
panorama and interpolates angles between them; `level_sets` parts it into things by forward distance,
`contours` and `silhouettes` say how far each is and where it ends, `sizes` how wide and how high, and
`obstacles` is what comes out of it all: obstacles and gaps from left to right, for planning. `pieces`
cuts what hangs together with a wall, and tells how far aside ground was seen; `printed` keeps the seed's own
formulas for sizes.

Sources: seed 004, sections 2.2.2 and 2.3; Brown and Lowe 2007; Lewis 1995.
"""
