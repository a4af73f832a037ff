"""Occupancy grids.

Read `evidence` (how one observation changes the occupancy probability of a cell), `heights` (surface height
of a cell and its variance), `hanging` (obstacles with room below them), `scrolling` (a window that moves over an
endless lattice without copying data), `egocentric_grid` (the terrain map round the robot), `confidence` (how recently
each of its cells was seen), `world_map` (probability and height of everything seen, on a fixed map that grows),
`tiles` (how it is kept), `rooms` (what it shows
when a walk is over) with `hills`, and `dynamic_traces` (removal of dynamic traces).

Sources: seed 003 (grid, evidence), seed 001 (confidence); heights and dynamic traces are ours.
"""
