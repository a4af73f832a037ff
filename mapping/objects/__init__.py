"""Shapes of single obstacles on the floor.

Read `footprints` (rectangles from the accumulated obstacle cloud) and `cuboid` (a box from one depth image).

Source: ours.
"""
