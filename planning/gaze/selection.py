"""The gaze map over pan and tilt, and the direction to take.

Each evaluation adds its value to all directions that show its target: the way point, an obstacle, stale ground. The
weighted sum is the integration map GM; the head turns to the middle of its highest plateau. The present direction is
kept unless another is clearly better, so that the head does not oscillate.

Source: Yoo 2010 (seed 001), section 3, eq. (5) and (6), Fig. 7. Ours: the true field of view instead of a rectangle
of pan and tilt (kept as `literal`), and keeping the direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.errors import ConfigError
from perception.primitives.pose import head_rotation
from perception.primitives.robot_model import DARWIN_OP, GaitLimits, HeadLimits
from perception.primitives.settings import setting

from ..commands import GazeCommand
from . import _gaze_kernels
from .evaluations import EvaluationConfig

LEAST_STEP_DEG = 0.1  # ours: 10^6 directions; ten times finer takes gigabytes
REST_S = 0.20  # dT of seed 000: from the first image of a step to the second, and the next decision


@dataclass(frozen=True)
class GazeMapConfig:
    """Directions, field of view, weights."""

    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    across_deg: float = (
        44.0  # seed 004; seed 001 has 60; horizontal field of view of the camera to aim
    )
    down_deg: float = 35.0  # seed 004; seed 001 has 45; vertical field of view of the camera to aim
    map_weight: float = setting(0.25, "", "weight w_lm of stale ground", "ours")
    way_weight: float = setting(0.25, "", "weight w_way of the way point", "ours")
    self_weight: float = setting(0.25, "", "weight w_sf of the robot's own position", "ours")
    obstacle_weight: float = setting(0.25, "", "weight w_ob of obstacles", "ours")
    keep: float = setting(
        0.10, "", "relative gain for which the gaze leaves its present direction", "ours"
    )
    head: HeadLimits = DARWIN_OP.head  # replaced by the robot's
    step_deg: float = 2.0  # ours: grid of directions
    literal: bool = False  # a rectangle of pan and tilt, and the mean of all stale ground

    def __post_init__(self) -> None:
        if not LEAST_STEP_DEG <= self.step_deg <= 10.0:
            raise ConfigError(
                f"gaze: step_deg={self.step_deg} must lie in [{LEAST_STEP_DEG:g}, 10]"
            )
        for name in ("across_deg", "down_deg"):
            value = getattr(self, name)
            if not 0.0 < value < 180.0:
                raise ConfigError(f"gaze: {name}={value} must lie in (0, 180)")
        for name in ("map_weight", "way_weight", "self_weight", "obstacle_weight", "keep"):
            if not getattr(self, name) >= 0.0:
                raise ConfigError(f"gaze: {name}={getattr(self, name)} must not be negative")

    @cached_property
    def pans(self) -> Float[np.ndarray, "rows"]:
        """Pan of each row of the map, rad, left positive; ahead and both ends of the range are among them."""
        most = self.head.pan_deg
        return _read_only(np.radians(np.linspace(-most, most, 2 * self._steps(most) + 1)))

    @cached_property
    def tilts(self) -> Float[np.ndarray, "columns"]:
        """Tilt of each column of the map, rad, down positive; both ends of the range are among them."""
        highest, lowest = self.head.tilt_deg
        return _read_only(
            np.radians(np.linspace(highest, lowest, self._steps(lowest - highest) + 1))
        )

    def _steps(self, range_deg: float) -> int:
        """Number of even steps of at most `step_deg`."""
        return math.ceil(range_deg / self.step_deg - 1e-9)


@dataclass(frozen=True, eq=False)
class DirectionMap:
    """A gaze map with its directions.

    Args:
        values: [pan, tilt].
        pans, tilts: Of its rows and columns, rad, left and down positive, ascending.
    """

    values: Float[np.ndarray, "pans tilts"]
    pans: Float[np.ndarray, "pans"]
    tilts: Float[np.ndarray, "tilts"]


def _read_only(directions: np.ndarray) -> np.ndarray:
    directions.setflags(write=False)
    return directions


def shown(
    places: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n"], config: GazeMapConfig
) -> Float[np.ndarray, "rows columns"]:
    """Total weight of the points that each gaze shows, [pan, tilt].

    Args:
        places: Relative to the camera, body axes (x ahead, y left, z up), m.
        weights: Of the points.
        config: Directions and field of view.
    """
    result = np.zeros((len(config.pans), len(config.tilts)))
    half_across, half_down = (math.radians(a) / 2 for a in (config.across_deg, config.down_deg))
    if config.literal:
        bearing = np.arctan2(places[:, 1], places[:, 0])
        below = np.arctan2(-places[:, 2], np.hypot(places[:, 0], places[:, 1]))
        across = np.abs(config.pans[:, None] - bearing) <= half_across
        down = np.abs(config.tilts[:, None] - below) <= half_down
        return np.asarray((across * weights) @ down.T.astype(float))
    _gaze_kernels.count(
        np.ascontiguousarray(places, np.float64),
        np.ascontiguousarray(weights, np.float64),
        config.pans,
        config.tilts,
        half_across,
        half_down,
        result,
    )
    return result


def in_view(
    places: Float[np.ndarray, "n 3"], gaze: GazeCommand, config: GazeMapConfig
) -> Bool[np.ndarray, "n"]:
    """Which points one gaze shows; the frustum of `shown`, for any direction.

    Args:
        places: Relative to the camera, body axes, m.
        gaze: Direction of the head.
        config: Field of view.
    """
    axes = head_rotation(gaze.pan_rad, gaze.tilt_rad)  # columns: right, down, ahead
    right, down, ahead = (places @ axes).T
    across, along = (math.tan(math.radians(a) / 2) for a in (config.across_deg, config.down_deg))
    inside = (np.abs(right) <= across * ahead) & (np.abs(down) <= along * ahead)
    return np.asarray(inside & (ahead > 0.0))


def gaze_map(
    psi_map: float,
    stale: Float[np.ndarray, "n 3"],
    psi_way: float,
    way: Float[np.ndarray, "3"],
    psi_self: float,
    psi_obstacles: Float[np.ndarray, "m"],
    obstacles: Float[np.ndarray, "m 3"],
    config: GazeMapConfig,
    landmarks: Float[np.ndarray, "k 3"] | None = None,
) -> Float[np.ndarray, "rows columns"]:
    """GM over pan and tilt.

    Args:
        psi_map, psi_way, psi_self, psi_obstacles: The evaluations.
        stale: Stale ground out of view, relative to the camera, body axes, m.
        way: The way point on the floor, likewise.
        obstacles: Positions on the floor, likewise.
        config: Directions, field of view, weights.
        landmarks: Landmarks that help localisation; None or empty: the obstacles serve, as in the paper.

    Source: seed 001, eq. (5) and (6).
    """
    total = config.way_weight * shown(way[None], np.array([psi_way]), config)
    if len(stale):
        total += config.map_weight * psi_map * _stale_share(stale, config)
    count = len(obstacles)
    if count:
        total += config.obstacle_weight / count * shown(obstacles, psi_obstacles, config)
    helpful = obstacles if landmarks is None or len(landmarks) == 0 else landmarks
    if len(helpful):
        each = np.full(len(helpful), psi_self / len(helpful))
        total += config.self_weight * shown(helpful, each, config)
    return total


def _stale_share(
    stale: Float[np.ndarray, "n 3"], config: GazeMapConfig
) -> Float[np.ndarray, "rows columns"]:
    """R_lm without its psi: share of the stale ground that each gaze shows, normalised to a maximum of 1.

    The printed form uses the mean of the stale ground, which for stale ground on both sides is the fresh middle.
    """
    if config.literal:
        return shown(stale.mean(axis=0)[None], np.ones(1), config)
    seen = shown(stale, np.ones(len(stale)), config)
    most = float(seen.max())
    return seen / most if most > 0.0 else seen


def highest_plateau(
    total: Float[np.ndarray, "rows columns"], present: GazeCommand, config: GazeMapConfig
) -> GazeCommand:
    """theta*: the middle of the connected region with the largest GM; of several the one nearest to the present gaze.

    Args:
        total: GM, [pan, tilt].
        present: Present direction of the head.
        config: Directions.
    """
    top = total >= float(total.max()) * (1.0 - 1e-9) - 1e-12
    rows, columns = _gaze_kernels.middles(top).T
    pans = np.interp(rows, np.arange(len(config.pans)), config.pans)
    tilts = np.interp(columns, np.arange(len(config.tilts)), config.tilts)
    nearest = int(np.argmin(np.hypot(pans - present.pan_rad, tilts - present.tilt_rad)))
    return GazeCommand(float(pans[nearest]), float(tilts[nearest]))


def worth(
    total: Float[np.ndarray, "rows columns"], gaze: GazeCommand, config: GazeMapConfig
) -> float:
    """GM at the cell nearest to a direction."""
    row = int(np.argmin(np.abs(config.pans - gaze.pan_rad)))
    column = int(np.argmin(np.abs(config.tilts - gaze.tilt_rad)))
    return float(total[row, column])


def select(
    total: Float[np.ndarray, "rows columns"],
    present: GazeCommand,
    aimed: GazeCommand | None,
    config: GazeMapConfig,
) -> GazeCommand:
    """The next direction of the head.

    Args:
        total: GM, [pan, tilt].
        present: Present direction of the head.
        aimed: Direction commanded before; None: none.
        config: Directions, and the gain that another direction needs.
    """
    best = highest_plateau(total, present, config)
    if aimed is not None and worth(total, aimed, config) * (1.0 + config.keep) >= float(
        total.max()
    ):
        return aimed
    return best


def first_image_s(gait: GaitLimits) -> float:
    """Time from the command to the first image of a step; T_DS + T_SS - dT of seed 000, half of a very short step."""
    return max(gait.step_s - REST_S, gait.step_s / 2.0)


def turned(present: GazeCommand, gaze: GazeCommand, head: HeadLimits, step_s: float) -> GazeCommand:
    """Direction of the head at the next decision, a step later, with both joints at top speed until then."""
    most = head.speed_radps * step_s
    pan = present.pan_rad + min(max(gaze.pan_rad - present.pan_rad, -most), most)
    tilt = present.tilt_rad + min(max(gaze.tilt_rad - present.tilt_rad, -most), most)
    return GazeCommand(pan, tilt)
