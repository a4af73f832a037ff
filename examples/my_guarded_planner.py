"""The planner of `my_planner.py` behind the guard, which changes the steps that would lead to contact.

surefoot simulate robots_room --planner examples.my_guarded_planner:WalkGuarded
"""

from dataclasses import replace

from examples.my_planner import WalkStraight
from mapping.grid.evidence import OCCUPIED
from planning.safety.guard import Guard
from planning.safety.guard_inputs import standing_cells, straight_tracks


class WalkGuarded(WalkStraight):
    def __init__(self, config, goals):
        super().__init__(config, goals)
        self.guard = Guard(config.guard, config.robot, config.cell_m)

    def decide(self, world):
        wanted, grid, tracks = super().decide(world), world.grid, straight_tracks(world.tracks)
        if self.goal is None or world.pose is None or grid is None:
            return wanted
        occupied = grid.centres()[grid.known & (grid.probability >= OCCUPIED)]
        standing = standing_cells(occupied, tracks, grid.cell_m)  # the guard predicts the others
        unseen = grid.centres()[~grid.known]
        walk = self.guard.choose(
            wanted.walk, world.pose, tracks, standing, self.goal, world.stamp_s, unseen
        )
        return wanted if walk == wanted.walk else replace(wanted, walk=walk, why=self.guard.word)
