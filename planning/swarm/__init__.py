"""The next footstep from one picture: a swarm, or an exact search, over the pixels of the floor.

Read in this order: `floor_rows` (what a pixel's row says about the floor), `objective` (distance to the
goal and the four penalties), `search` (the particle swarm in its modes, and the exact search that sweeps
the picture from the feet upwards), `corners` (what the feet have just lost sight of), `command` (the best
pixel as a footstep), `glances` (looking aside for who is lost there). Compiled loops
are in the modules whose names end in `_kernels`.

Source: seed 000, sections 4 and 5.
"""
