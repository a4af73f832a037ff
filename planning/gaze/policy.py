"""The gaze policies: by the evaluations, by a fixed order of glances, or always straight ahead.

With the evaluations the head turns to the middle of the highest plateau of the gaze map, among the directions that
it reaches before the next image, and keeps its direction unless another is clearly better.

Source: Yoo 2010 (seed 001), section 3 (evaluations), section 7 (integration with the gait); the initial survey and
the other two policies are ours.
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
from perception.primitives.settings import setting

from ..commands import GazeCommand
from .attention import Attention, AttentionModel, GazeContext
from .evaluations import EvaluationConfig
from .selection import GazeMapConfig, select
from .sweep import TILT_DEG, Sweep

MODES = ("evaluations", "sweep", "fixed")
FIRST_IMAGE_S = 0.45  # T_DS + T_SS - dT of seed 000: from the command to the first image of a step
REST_S = 0.20  # dT of seed 000: from the first image of a step to the second, and the next decision

LIVE_MAP = GazeMapConfig(
    evaluation=EvaluationConfig(self_sigma_m=0.03),
    step_deg=3.0,
    map_weight=0.20,
    obstacle_weight=0.40,
)
"""Ours: with landmarks the position is known to 1 or 2 cm, so that T_sf = 0.10 m would never turn the head; most
contacts are with obstacles out of sight, so they weigh more than stale ground; 3 deg take half the time of 2 deg."""


@dataclass(frozen=True)
class GazeConfig:
    """The policy and the gaze map of its evaluations."""

    mode: str = setting(
        "evaluations", "", "gaze policy: evaluations, sweep or fixed (straight ahead)", "seed 001"
    )
    map: GazeMapConfig = field(default_factory=lambda: LIVE_MAP)

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ConfigError(f"gaze: mode={self.mode!r} is unknown; choose {', '.join(MODES)}")


class GazePolicy:
    """Chooses one gaze per footstep."""

    def __init__(self, config: GazeConfig, robot: RobotModel = DARWIN_OP) -> None:
        self._config, self._head = config, robot.head
        self._sweep = Sweep(robot.head)
        self._model = AttentionModel(config.map, robot)
        self._present = GazeCommand(0.0, math.radians(TILT_DEG))
        self.attention: Attention | None = None
        """The evaluations of the last decision; None if another policy made it."""

    @property
    def surveying(self) -> bool:
        """Whether the initial survey is under way; the robot should stand meanwhile."""
        return self._config.mode != "fixed" and self._sweep.surveying

    def survey(self) -> None:
        """Survey the surroundings again, from the next gaze on."""
        self._sweep.survey()

    def next(
        self,
        stamp_s: float,
        robot: Pose2,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: GazeContext | None = None,
    ) -> GazeCommand:
        """The gaze until the next footstep.

        Args:
            stamp_s: Present time, in the clock of `Obstacle.seen_s`.
            robot: Pose, world frame.
            via: Via point, world frame, m.
            obstacles: Tracks, world frame.
            known: Input of the evaluations; None: the sweep decides.
        """
        config, self.attention = self._config, None
        if config.mode == "fixed":
            gaze = GazeCommand(0.0, math.radians(TILT_DEG))
        elif config.mode == "sweep" or known is None or self._sweep.surveying:
            gaze = self._sweep.next(stamp_s, robot, via, obstacles)
        else:
            self.attention = self._model.weigh(stamp_s, via, obstacles, known, self._present)
            reached = self._within_reach(self.attention.total)
            gaze = select(reached, self._present, self._present, self._model.config)
        if known is not None:
            self._model.decided(stamp_s, gaze, via, obstacles, known.pose)
        self._present = self._turned(gaze)
        return gaze

    def _within_reach(
        self, total: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """The map, 0 at directions that the head does not reach in time."""
        gaze: GazeMapConfig = self._model.config
        reach = self._head.speed_radps * FIRST_IMAGE_S
        far = np.abs(gaze.pans[:, None] - self._present.pan_rad) > reach
        far = far | (np.abs(gaze.tilts - self._present.tilt_rad) > reach)
        return np.where(far, 0.0, total)

    def _turned(self, gaze: GazeCommand) -> GazeCommand:
        """Direction of the head at the next decision, with both joints at top speed until then."""
        most = self._head.speed_radps * (FIRST_IMAGE_S + REST_S)
        pan = self._present.pan_rad + min(max(gaze.pan_rad - self._present.pan_rad, -most), most)
        tilt = self._present.tilt_rad + min(
            max(gaze.tilt_rad - self._present.tilt_rad, -most), most
        )
        return GazeCommand(pan, tilt)
