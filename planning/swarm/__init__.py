"""The next footstep from one colour picture: search over the pixels of the floor.

In reading order: `floor_rows` (floor geometry of the rows of a picture), `objective` (distance to the goal and four
penalties), `search` (the particle swarm and an exact search), `corners` (obstacles that have just left the picture beside
the feet), `command` (the best pixel as a footstep), `ground_memory` (contacts and floor seen during the last steps),
`glances` (looks aside for obstacles out of sight), `settings`, `random_floors` (test
scenes). Modules whose names end in `_kernels` hold compiled loops.

Source: Han 2018 (seed 000), sections 4 and 5.
"""
