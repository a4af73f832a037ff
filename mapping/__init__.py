"""Mapping: the robot's memory of what it perceived.

Rooms, in the order to read them:

- `grid`: the egocentric terrain map, the world map, and how recently each cell was seen;
- `surface`: a dense surface of a whole place, and where a foot can stand on it;
- `panorama`: views of a turning head on one sphere, and the obstacles and gaps in it;
- `objects`: footprints and boxes of obstacles on the floor;
- `io`: maps and clouds as files.

`open3d_objects` gives all of them as objects of Open3D (`to_open3d()`).

Grids are indexed [row, column]: rows along world y, columns along world x, row 0 at the smallest y. The
origin is the lower left corner of cell [0, 0] in the world frame. Compiled loops are in `_*_kernels`.

Sources: seed 003 (grid), seed 001 (confidence), seed 004 (panorama); the rest is ours.
"""
