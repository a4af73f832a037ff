"""Tables of a run over ground of several levels: height of the body, where each foot landed, and the path with heights."""

from __future__ import annotations

import math

from mapping.ground.levels import Levels
from perception.primitives.gaussian import Gaussian
from planning.planners.planner import Decision

from .row_stream import PoseStream, RowStream
from .run_folder import RunFolder

FOOTSTEPS, HEIGHTS = "footsteps.csv", "heights.csv"
FOOTSTEP_HEADER = ("stamp_s", "foot", "x_m", "y_m", "yaw_rad", "height_m", "missed", "unseen")


class LevelLog:
    """Writes them frame by frame; it can be kept in a checkpoint."""

    def __init__(self, folder: RunFolder) -> None:
        self._trajectory = PoseStream(folder, "trajectory.txt")
        self._heights = RowStream(folder, HEIGHTS, ("stamp_s", "height_m", "sigma_m"))
        self._footsteps = RowStream(folder, FOOTSTEPS, FOOTSTEP_HEADER)
        self._claimed = (math.nan, math.nan)  # of the step on its way
        self._landings = 0

    def note(
        self, stamp_s: float, levels: Levels, pose: Gaussian, decision: Decision | None
    ) -> None:
        """A frame, and the decision about the next step."""
        height_m, sigma_m = levels.body_m
        x, y, yaw = pose.mean.tolist()
        self._trajectory.append((stamp_s, x, y, height_m, yaw))
        self._heights.append((stamp_s, height_m, sigma_m))
        if levels.landings > self._landings:
            foot, stands = "left" if levels.foot > 0 else "right", levels.stands
            place = (stands.x, stands.y, stands.yaw, levels.ground_m)
            self._footsteps.append((stamp_s, foot, *place, *self._claimed))
            self._landings = levels.landings
        if decision is not None:
            planned = None if decision.plan is None else decision.plan.foothold
            self._claimed = (
                (math.nan, math.nan) if planned is None else (planned.missed, planned.unseen)
            )

    def close(self) -> None:
        """Close all tables."""
        for table in (self._trajectory, self._heights, self._footsteps):
            table.close()
