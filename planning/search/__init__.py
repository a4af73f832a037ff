"""Where to go: via points from the terrain map.

Read `potential` (how unpleasant a cell is, and which cells the body cannot enter), `astar` (the search
over path cost plus estimate, and `find_path`, which joins everything), `path` (the map made ready, and the
way found), `shortcuts` (straightening the lattice path and rounding its corners). Compiled loops are in `_potential_kernels`, `_lattice_kernels` and
`_segment_kernels`.

Source: seed 003, section 3: repulsive potential, evaluation function, shortcuts; ambiguities 3 to 5.
"""
