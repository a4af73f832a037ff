"""The gaze policies: by the evaluations, by a fixed order of glances, or always straight ahead.

A policy of a user's own has the one method of `GazePolicy`, and a constructor that takes `GazeConfig` and
`RobotModel`; planners reach every policy through a `GazeControl`. One that values directions may derive from
`MapGaze`.

With the evaluations the head turns to the middle of the highest plateau of the gaze map, in which a direction that it
does not reach before the next image counts less by the time that it takes, and keeps its direction unless another is
clearly better.

Source: Yoo 2010 (seed 001), section 3 (evaluations), section 7 (integration with the gait); the initial survey and
the other policies here are ours; `univector.published_gaze` has that of seed 001 alone.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, cast, runtime_checkable

import numpy as np
from jaxtyping import Float

from perception.primitives import plugins
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, RobotModel
from perception.primitives.settings import setting

from ..commands import GazeCommand
from ..plugin_calls import call, check_finite
from .attention import Attention, AttentionModel, GazeContext
from .evaluations import EvaluationConfig
from .selection import (
    DirectionMap,
    GazeMapConfig,
    first_image_s,
    highest_plateau,
    select,
    turned,
)
from .sweep import TILT_DEG, Sweep

POLICIES = {
    "evaluations": "planning.gaze.policy:EvaluationGaze",
    "seed": "planning.univector.published_gaze:PublishedGaze",
    "sweep": "planning.gaze.policy:SweepGaze",
    "fixed": "planning.gaze.policy:FixedGaze",
}
"""Our policies: name to class."""

TURN_WORTH = 0.5  # ours: worth of the steps that a turn of the body for a look costs

AHEAD = GazeCommand(0.0, math.radians(TILT_DEG))

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
        "evaluations",
        "",
        "gaze policy: evaluations, seed (the same as published), sweep, fixed (straight ahead), or package.module:Class",
        "seed 001",
    )
    map: GazeMapConfig = field(default_factory=lambda: LIVE_MAP)

    def __post_init__(self) -> None:
        problem = plugins.check(self.mode, POLICIES, "gaze policy")
        if problem is not None:
            raise ConfigError(f"gaze: {problem}")


@runtime_checkable
class GazePolicy(Protocol):
    """Chooses one gaze per footstep.

    A policy that surveys its surroundings first, while the robot stands, has `surveying` and `survey()` too; one that
    wants the body to turn has `turning`.
    """

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
            known: Pose with covariance, grid, its confidence, landmarks, clusters; None if not known.
        """
        ...


class GazeControl:
    """The configured policy as planners use it."""

    def __init__(self, config: GazeConfig, robot: RobotModel = DARWIN_OP) -> None:
        """Make the policy.

        Raises:
            InputError: A policy of the user's cannot be loaded or made.
        """
        self._name = config.mode
        made = plugins.load(config.mode, POLICIES, "gaze policy", ("next",))
        self.policy = cast(GazePolicy, call(f"gaze policy {self._name!r}", made, config, robot))

    @property
    def surveying(self) -> bool:
        """Whether a survey is under way; the robot should stand meanwhile."""
        return bool(getattr(self.policy, "surveying", False))

    @property
    def turning(self) -> int:
        """Where the body should turn for a look beyond the range of the neck: 1 left, -1 right, 0 nowhere."""
        return int(getattr(self.policy, "turning", 0))

    @property
    def valued(self) -> DirectionMap | None:
        """The map by which the last gaze was chosen, for viewers; None if it was chosen otherwise."""
        found = getattr(self.policy, "valued", None)
        return found if isinstance(found, DirectionMap) else None

    def survey(self) -> None:
        """Survey the surroundings again, from the next gaze on, if the policy does so."""
        again = getattr(self.policy, "survey", None)
        if again is not None:
            again()

    def next(
        self,
        stamp_s: float,
        robot: Pose2,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: GazeContext | None = None,
    ) -> GazeCommand:
        """The gaze until the next footstep; arguments as for `GazePolicy`.

        Raises:
            InputError: A policy of the user's takes other arguments, or returns something else.
        """
        name = f"gaze policy {self._name!r}"
        gaze = call(name, self.policy.next, stamp_s, robot, via, obstacles, known)
        if not isinstance(gaze, GazeCommand):
            raise InputError(f"{name} returned a {type(gaze).__name__}; expected a GazeCommand")
        check_finite(name, gaze)
        return gaze


class FixedGaze:
    """Always straight ahead."""

    def __init__(self, config: GazeConfig, robot: RobotModel = DARWIN_OP) -> None:
        """Nothing is configured."""

    def next(
        self,
        stamp_s: float,
        robot: Pose2,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: GazeContext | None = None,
    ) -> GazeCommand:
        """The same as ever."""
        return AHEAD


class SweepGaze(Sweep):
    """Survey, path and glances in a fixed order."""

    def __init__(self, config: GazeConfig, robot: RobotModel = DARWIN_OP) -> None:
        super().__init__(robot.head)

    def next(
        self,
        stamp_s: float,
        robot: Pose2,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: GazeContext | None = None,
    ) -> GazeCommand:
        """As `Sweep.next`; nothing else counts."""
        return super().next(stamp_s, robot, via, obstacles)


class MapGaze(ABC):
    """Base of policies that look where a map over pan and tilt is highest."""

    def __init__(self, map_config: GazeMapConfig, robot: RobotModel) -> None:
        self.map = map_config
        self.robot = robot
        self.present = AHEAD
        self.valued: DirectionMap | None = None

    def next(
        self,
        stamp_s: float,
        robot: Pose2,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: GazeContext | None = None,
    ) -> GazeCommand:
        """The middle of the highest plateau; straight ahead where nothing has a value."""
        gaze, self.valued = AHEAD, None
        if known is not None:
            total = self.total(via, obstacles, known)
            self.valued = DirectionMap(total, self.map.pans, self.map.tilts)
            if total.max() > 0.0:
                gaze = highest_plateau(total, self.present, self.map)
        self.present = turned(self.present, gaze, self.robot.head, self.robot.gait.step_s)
        return gaze

    @abstractmethod
    def total(
        self, via: Float[np.ndarray, "2"], obstacles: Sequence[Obstacle], known: GazeContext
    ) -> Float[np.ndarray, "rows columns"]:
        """Value of every direction, [pan, tilt]; arguments as for `next`."""


class EvaluationGaze:
    """By the evaluations; surveys first, and sweeps where their input is missing."""

    def __init__(self, config: GazeConfig, robot: RobotModel = DARWIN_OP) -> None:
        self._head, self._gait = robot.head, robot.gait
        self._sweep = Sweep(robot.head)
        self._model = AttentionModel(config.map, robot)
        self._present = AHEAD
        self.attention: Attention | None = None
        """The evaluations of the last decision; None if another policy made it."""
        self.turning = 0
        """Where the body should turn for a look beyond the range of the neck: 1 left, -1 right, 0 nowhere."""

    @property
    def surveying(self) -> bool:
        """Whether the initial survey is under way; the robot should stand meanwhile."""
        return self._sweep.surveying

    @property
    def valued(self) -> DirectionMap | None:
        """The gaze map of the last decision; None if another policy made it."""
        if self.attention is None:
            return None
        return DirectionMap(self.attention.total, self._model.config.pans, self._model.config.tilts)

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
        """The best direction of the gaze map for the time that the head takes to get there."""
        self.attention, self.turning = None, 0
        if known is None or self._sweep.surveying:
            gaze = self._sweep.next(stamp_s, robot, via, obstacles)
        else:
            self.attention = self._model.weigh(stamp_s, via, obstacles, known, self._present)
            soon = self._by_time(self.attention.total)
            gaze = select(soon, self._present, self._present, self._model.config)
            self._consider_turn(float(soon.max()))
        self._present = turned(self._present, gaze, self._head, self._gait.step_s)
        if known is not None:
            self._model.decided(stamp_s, self._present, via, obstacles, known.pose)
        return gaze

    def _consider_turn(self, best: float) -> None:
        """Turn the body if that shows more, by the time that it takes, than the best direction of the head and the way."""
        assert self.attention is not None
        left, right = self.attention.turned
        if max(left, right) > best + TURN_WORTH:
            self.turning = 1 if left >= right else -1

    def _by_time(
        self, total: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """The map by the time that the head takes, where it comes too late for the first image of the step."""
        gaze: GazeMapConfig = self._model.config
        pan = np.abs(gaze.pans[:, None] - self._present.pan_rad)
        turn_s = (
            np.maximum(pan, np.abs(gaze.tilts - self._present.tilt_rad)) / self._head.speed_radps
        )
        first_s = first_image_s(self._gait)
        return total * (first_s / np.maximum(turn_s, first_s))
