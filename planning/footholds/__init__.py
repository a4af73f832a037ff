"""Footholds: where the next feet may stand on ground of several levels, and the chance that one of them misses an edge.

Read in this order: `foothold` (a sole on a surface, and its chance to miss an edge), `search` (the footsteps to a goal).

`search` next door plans for a robot on flat ground; here every footstep has a place of its own.

Source: Deits and Tedrake 2014, Griffin et al. 2019 (footsteps on plane regions; A* over footsteps); the chances are ours.
"""
