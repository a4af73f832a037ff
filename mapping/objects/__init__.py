"""Shapes of single obstacles on the floor.

Read `obstacle_cloud` (what a run remembers), `footprints` (outlines from it), which uses `columns`, `faces`, `outlines`,
`pixels`,
`free_cells` and `sides`, and `cuboid` (a box from one depth image).

Source: ours.
"""
