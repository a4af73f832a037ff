"""Mapping: what do we remember.

Read in this order: `evidence` (how a sighting changes the probability of a cell), `heights` (how high its
surface is, and how sure that is), `scrolling` (a window that an offset moves over an endless lattice),
`egocentric_grid` (the terrain map that walks with the robot), `confidence` (how fresh each of its cells
is), `grid_file` (all of that as one file), `world_map` (the same evidence on a map that stays and grows),
`nav2` (that map as files which ROS opens), `clouds` (coloured points of a run, voxel by voxel),
`footprints` (the ground plan of what stands on the floor), `cuboid` (a box on the floor, from one view),
`panorama` (what the head sees all round, in one picture of ranges), `tsdf` with `meshes` (the surface of a
whole place), `traversability` (where one can walk on it), and `whole_files` (a file is complete or
absent).

Grids are indexed [row, column]: rows along world y, columns along world x, row 0 at the smallest y; the
origin is the lower left corner of cell [0, 0] in the world frame. Compiled inner loops are in `_kernels`
and `_grid_kernels`.

Sources: seed 003 (grid), seed 001 (confidence), the map_server format of ROS (nav2); the rest is ours.
"""
