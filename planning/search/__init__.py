"""Path search: via points from the terrain map.

In reading order: `potential` (cost of a cell, and cells that the body cannot enter), `astar` (the search, and
`find_path`), `path` (the prepared map and the resulting path), `shortcuts` (straight segments and rounded corners),
`memory` (ground beyond the local map), `route` (one via point per footstep, with memory), `curve_walk` (the rounded
curve as one aim per footstep). Compiled loops are in `_potential_kernels`, `_lattice_kernels` and `_segment_kernels`.

Source: seed 003, section 3: repulsive potential, evaluation function, shortcuts; ambiguities 3 to 5.
"""
