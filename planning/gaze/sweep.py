"""The first gaze policy: look where the next steps go, glance aside in between, follow what moves.

One gaze per footstep. Before the first step the robot stands and looks all round, as far as its neck
allows. Afterwards every other gaze goes where it walks; the gazes between go to a mover that was not seen
for a while, else left and right in turn.

Source: seed 003, section 5 (head command: the next way point, and sweeps); order and intervals are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import DARWIN_OP, HeadLimits

from ..commands import GazeCommand


@dataclass(frozen=True)
class SweepConfig:
    """Angles and intervals of the gaze."""

    tilt_deg: float = 28.0  # ours: from 0.38 m, 35 deg of view, sees the floor from 0.4 to 2.1 m
    near_tilt_deg: float = 38.0  # ours: from 0.3 to 1.0 m, where something close must be followed
    near_m: float = 0.6  # ours: closer than this is close
    survey_pans_deg: tuple[float, ...] = (0.0, 40.0, 80.0, 40.0, 0.0, -40.0, -80.0, -40.0)
    # ours: neighbouring gazes overlap for the narrowest view (44 deg)
    glance_pans_deg: tuple[float, ...] = (40.0, -40.0, 80.0, -80.0)  # ours
    revisit_s: float = 1.0  # own: a mover unseen for longer is looked for
    close_m: float = 1.2  # ours: a mover this near ...
    close_revisit_s: float = 0.6  # ours: ... is looked for already after this
    revisit_m: float = 2.0  # own: if it is this near
    unwatched_s: float = 2.0  # own: the walking direction is never left for longer
    view_deg: float = 44.0  # seed 004: across the narrowest depth camera

    def __post_init__(self) -> None:
        if not self.survey_pans_deg or not self.glance_pans_deg:
            raise ConfigError(
                "sweep: survey_pans_deg and glance_pans_deg need at least one angle each"
            )


class Sweep:
    """Decides each footstep's gaze; remembers when each direction had its turn."""

    def __init__(self, config: SweepConfig, head: HeadLimits = DARWIN_OP.head) -> None:
        for pan in (*config.survey_pans_deg, *config.glance_pans_deg):
            if not abs(pan) <= head.pan_deg:
                raise ConfigError(
                    f"sweep: pan of {pan} deg exceeds the neck's range of {head.pan_deg} deg; lower it"
                )
        self._config, self._limit = config, math.radians(head.pan_deg)
        self._surveyed = 0
        self._glances = 0
        self._ahead_s = -math.inf  # when the walking direction was last looked at
        self._aside = False  # whether the gaze before was aside
        self._sought_s: dict[int, float] = {}  # by track: when it was last looked for

    @property
    def surveying(self) -> bool:
        """Whether the first look round is still under way; the robot should stand meanwhile."""
        return self._surveyed <= len(self._config.survey_pans_deg)

    def survey(self) -> None:
        """Look all round once more, from the next gaze on."""
        self._surveyed = 0

    def next(
        self,
        stamp_s: float,
        robot: Pose2,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
    ) -> GazeCommand:
        """Where to look until the next footstep.

        Args:
            stamp_s: Now, in the clock of `Obstacle.seen_s`.
            robot: Where it stands, world frame.
            via: The point it walks to, world frame, m.
            obstacles: Tracks, world frame.
        """
        config = self._config
        if self._surveyed < len(config.survey_pans_deg):
            pan = math.radians(config.survey_pans_deg[self._surveyed])
            self._surveyed += 1
            return self._gaze(pan, math.inf)
        self._surveyed += 1
        ahead = self._walking(robot, via)
        overdue = stamp_s - self._ahead_s >= config.unwatched_s - 0.7
        if self._aside and overdue:
            return self._look_ahead(stamp_s, ahead)
        lost = self._lost(stamp_s, robot, obstacles)
        if lost is not None:
            self._aside = True
            track, pan, distance = lost
            self._sought_s[track] = stamp_s
            return self._gaze(pan, distance)
        if self._aside or self._ahead_s == -math.inf:
            return self._look_ahead(stamp_s, ahead)
        self._aside = True
        pan = math.radians(config.glance_pans_deg[self._glances % len(config.glance_pans_deg)])
        self._glances += 1
        return self._gaze(ahead + pan if abs(ahead + pan) <= self._limit else pan, math.inf)

    def _walking(self, robot: Pose2, via: np.ndarray) -> float:
        """Pan of the walking direction: towards the via point, half of it where it is far aside."""
        dx, dy = float(via[0]) - robot.x, float(via[1]) - robot.y
        if math.hypot(dx, dy) < 0.05:
            return 0.0
        off = wrap_angle(math.atan2(dy, dx) - robot.yaw)
        return min(max(off, -self._limit), self._limit)

    def _look_ahead(self, stamp_s: float, pan: float) -> GazeCommand:
        self._ahead_s = stamp_s
        self._aside = False
        return self._gaze(pan, math.inf)

    def _lost(
        self, stamp_s: float, robot: Pose2, obstacles: Sequence[Obstacle]
    ) -> tuple[int, float, float] | None:
        """Track, pan and distance of the mover that most needs a look: longest without one, and near."""
        config = self._config
        best, found = 0.0, None
        reach = self._limit + math.radians(config.view_deg / 2)
        for obstacle in obstacles:
            unseen = stamp_s - obstacle.seen_s
            alone = min(unseen, stamp_s - self._sought_s.get(obstacle.track, -math.inf))
            if obstacle.moving < MOVING:
                continue
            for place in _may_be(obstacle, unseen):
                dx, dy = float(place[0]) - robot.x, float(place[1]) - robot.y
                distance = math.hypot(dx, dy)
                pan = wrap_angle(math.atan2(dy, dx) - robot.yaw)
                patience = config.close_revisit_s if distance < config.close_m else config.revisit_s
                if alone <= patience or distance > config.revisit_m or abs(pan) > reach:
                    continue
                need = alone / max(distance, 0.3)
                if need > best:
                    best, found = need, (obstacle.track, pan, distance)
        return found

    def _gaze(self, pan: float, distance_m: float) -> GazeCommand:
        near = distance_m < self._config.near_m
        tilt = self._config.near_tilt_deg if near else self._config.tilt_deg
        return GazeCommand(min(max(pan, -self._limit), self._limit), math.radians(tilt))


def _may_be(obstacle: Obstacle, unseen_s: float) -> list[Float[np.ndarray, "2"]]:
    """Where a mover may be that was not seen for a while: gone on, or turned back at once."""
    back = obstacle.position - 2.0 * obstacle.velocity * unseen_s
    return [obstacle.position] if unseen_s < 3.0 else [obstacle.position, back]
