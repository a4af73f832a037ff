"""Where to look next: by the evaluations, by a fixed order of glances, or always straight ahead.

All three have the same face, so that they can be compared. By the evaluations the head turns to the middle of
the gaze map's highest plateau, among the directions that it reaches before the next picture; it stays where it
looks unless another direction is worth clearly more.

Source: seed 001, section 3 (evaluations), section 7 (integration at the gait's rhythm); the look round at the
start, and what the other two do, are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, RobotModel

from ..commands import GazeCommand
from .attention import Attention, AttentionConfig, AttentionModel, GazeContext
from .selection import GazeMapConfig, select
from .sweep import Sweep, SweepConfig

MODES = ("evaluations", "sweep", "fixed")
REST_S = (
    0.20  # dT of seed 000: from the first picture of a step to its second, and the next decision
)


@dataclass(frozen=True)
class GazeConfig:
    """Which policy, its parts, and how fast the head is.

    Args:
        mode: "evaluations", "sweep" or "fixed".
        attention: Of "evaluations".
        sweep: Of "sweep"; its look round at the start serves "evaluations" too.
    """

    mode: str = "evaluations"
    attention: AttentionConfig = field(default_factory=AttentionConfig)
    sweep: SweepConfig = field(default_factory=SweepConfig)
    fixed_tilt_deg: float = 28.0  # ours: as the sweep's, the floor from 0.4 to 2.1 m
    turning_s: float = 0.45  # T_DS + T_SS - dT, seed 000: from command to first picture

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ConfigError(f"gaze: mode={self.mode!r} is unknown; choose {', '.join(MODES)}")
        if not (math.isfinite(self.turning_s) and self.turning_s > 0.0):
            raise ConfigError(f"gaze: turning_s={self.turning_s} must be positive and finite")


class GazePolicy:
    """Decides each footstep's gaze."""

    def __init__(self, config: GazeConfig, robot: RobotModel = DARWIN_OP) -> None:
        self._config, self._head = config, robot.head
        self._sweep = Sweep(config.sweep, robot.head)
        self._attentive = AttentionModel(config.attention, robot)
        self._present = GazeCommand(0.0, math.radians(config.fixed_tilt_deg))
        self.attention: Attention | None = None
        """What the last decision weighed; None where it did not weigh anything."""

    @property
    def surveying(self) -> bool:
        """Whether a look round is under way; the robot should stand meanwhile."""
        return self._config.mode != "fixed" and self._sweep.surveying

    def survey(self) -> None:
        """Look all round once more, from the next gaze on."""
        self._sweep.survey()

    def next(
        self,
        stamp_s: float,
        robot: Pose2,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: GazeContext | None = None,
    ) -> GazeCommand:
        """Where to look until the next footstep.

        Args:
            stamp_s: Now, in the clock of `Obstacle.seen_s`.
            robot: Where it stands, world frame.
            via: The point it walks to, world frame, m.
            obstacles: Tracks, world frame.
            known: What the evaluations need; None: the sweep decides.
        """
        config, self.attention = self._config, None
        if config.mode == "fixed":
            gaze = GazeCommand(0.0, math.radians(config.fixed_tilt_deg))
        elif config.mode == "sweep" or known is None or self._sweep.surveying:
            gaze = self._sweep.next(stamp_s, robot, via, obstacles)
        else:
            self.attention = self._attentive.weigh(stamp_s, via, obstacles, known, self._present)
            reached = self._within_reach(self.attention.total)
            gaze = select(reached, self._present, self._present, self._attentive.config.map)
        if known is not None:
            self._attentive.decided(stamp_s, gaze, via, obstacles, known.pose)
        self._present = self._turned(gaze)
        return gaze

    def _within_reach(
        self, total: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """The map, nothing where the head does not get in time."""
        gaze: GazeMapConfig = self._attentive.config.map
        reach = self._head.speed_radps * self._config.turning_s
        far = np.abs(gaze.pans[:, None] - self._present.pan_rad) > reach
        far = far | (np.abs(gaze.tilts - self._present.tilt_rad) > reach)
        return np.where(far, 0.0, total)

    def _turned(self, gaze: GazeCommand) -> GazeCommand:
        """Where the head is when the next footstep is due: both joints go on until then."""
        most = self._head.speed_radps * (self._config.turning_s + REST_S)
        pan = self._present.pan_rad + min(max(gaze.pan_rad - self._present.pan_rad, -most), most)
        tilt = self._present.tilt_rad + min(
            max(gaze.tilt_rad - self._present.tilt_rad, -most), most
        )
        return GazeCommand(pan, tilt)
