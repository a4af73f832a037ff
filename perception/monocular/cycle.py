"""One monocular cycle, in the order of the seed: ground, edges, flow, prediction, result image.

Source: seed 000, section 5, steps 1 to 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from ..primitives.errors import ConfigError, InputError
from ..primitives.settings import setting
from .adaptation import AdaptationConfig, FloorColours
from .back_projection import FARTHEST_M, nearest_distance_m
from .deviations import DeviationConfig, Sureness
from .edges import find_edges
from .flow import FlowConfig, follow
from .ground import GroundConfig, ground_image
from .movable import predicted_image
from .obstacles import floor_flows, least_speeds, seen_obstacles
from .result import Flows, MonocularResult, Picture


@dataclass(frozen=True)
class MonocularConfig:
    """The cycle of one camera."""

    use: str = setting(
        "auto",
        "",
        "when the pipeline looks for obstacles by colour: always, never, or auto (the planner needs it, or depth is lost)",
        "ours",
    )
    horizon_s: float = 0.65  # seed 000: T_DS + T_SS
    static_mps: float = 0.02  # seed 000: slower counts as standing
    fastest_mps: float = 0.5  # ours: robots have 0.1, corners taken for others 0.8 to 2;
    # what is faster is predicted to stand, and its covariance tells how fast it may be: where people walk, raise it
    noise_px: float = 0.25  # ours: what corners are followed to; a flow that this explains is none
    farthest_m: float = FARTHEST_M
    corner_px: int = 20  # ours: side of the squares that are looked at for S_m; 2.5 cm of floor
    adaptation: AdaptationConfig = field(default_factory=AdaptationConfig)
    ground: GroundConfig = field(default_factory=GroundConfig)
    flow: FlowConfig = field(default_factory=FlowConfig)
    deviations: DeviationConfig = field(default_factory=DeviationConfig)

    def __post_init__(self) -> None:
        if self.use not in ("auto", "always", "never"):
            raise ConfigError(
                f"monocular: use={self.use!r} is unknown; choose auto, always or never"
            )
        for name in ("horizon_s", "static_mps", "noise_px"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"monocular: {name}={value} must be finite and not negative")
        for name in ("farthest_m", "fastest_mps"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"monocular: {name}={value} must be positive and finite")
        if self.corner_px < 1:
            raise ConfigError(f"monocular: corner_px={self.corner_px} must be at least 1")


class Monocular:
    """Lives from cycle to cycle: the colours of the floor are what it remembers."""

    def __init__(self, config: MonocularConfig) -> None:
        self.config = config
        self.colours = FloorColours(config.adaptation)

    def cycle(self, previous: Picture | None, current: Picture) -> MonocularResult:
        """Everything one pair of pictures says.

        Args:
            previous: Taken at T_SS - dT; None if there is none (then nothing moves).
            current: Taken at T_SS.

        Raises:
            InputError: the pair is not in the order of time, or of two cameras.
        """
        if previous is not None:
            _check(previous, current)
        config = self.config
        nearest_m = nearest_distance_m(current.camera, current.T_world_camera)
        if math.isfinite(nearest_m):  # the lowest rows look at the floor
            self.colours.learn(current.rgb, current.T_world_camera)
        ground = self._ground(current)
        edges = find_edges(ground)
        flows = _no_flows()
        if previous is not None and edges.groups:
            begin, end = follow(
                previous.rgb, current.rgb, self._ground(previous), ground, config.flow
            )
            owners = edges.owners(end, float(config.flow.band_px))
            flows = floor_flows(begin, end, previous, current, owners, config.farthest_m)
        obstacles = seen_obstacles(
            edges,
            flows,
            current,
            config.horizon_s,
            config.farthest_m,
            self._least_speeds(previous, current, flows),
            config.fastest_mps,
            Sureness(previous, current, config.horizon_s, config.noise_px, config.deviations),
        )
        predicted = predicted_image(ground, obstacles, current)
        movable = cv2.subtract(ground, predicted)
        return MonocularResult(
            previous=previous,
            current=current,
            ground=ground,
            static=np.asarray(cv2.bitwise_not(ground), dtype=np.uint8),
            edges=edges.image,
            flows=flows,
            obstacles=obstacles,
            predicted=predicted,
            movable=np.asarray(movable, dtype=np.uint8),
            horizon_s=config.horizon_s,
            nearest_m=nearest_m,
            corners_blocked=_corners_blocked(movable, config.corner_px),
        )

    def _least_speeds(
        self, previous: Picture | None, current: Picture, flows: Flows
    ) -> Float[np.ndarray, "n"]:
        """How fast each flow must be to count as motion, m/s."""
        if previous is None or not len(flows):
            return np.zeros(0)
        return least_speeds(flows, previous, current, self.config.static_mps, self.config.noise_px)

    def _ground(self, picture: Picture) -> UInt8[np.ndarray, "h w"]:
        """I_g; nothing as long as no floor was seen to learn from."""
        if self.colours.range is None:
            return np.zeros(picture.rgb.shape[:2], np.uint8)
        return self.ground_of(picture)

    def ground_of(self, picture: Picture) -> UInt8[np.ndarray, "h w"]:
        """I_g of a picture by the colours as they are remembered now.

        Raises:
            InputError: nothing is remembered yet; call `cycle`, or `colours.learn`, first.
        """
        if self.colours.range is None:
            raise InputError("no floor colours are known yet; learn them from a picture first")
        return ground_image(picture, self.colours.range, self.config.ground, self.colours.core)


def _check(previous: Picture, current: Picture) -> None:
    if not current.stamp_s > previous.stamp_s:
        raise InputError(
            f"the current picture, at {current.stamp_s} s, must be later than the previous one, "
            f"at {previous.stamp_s} s; swap them"
        )
    if previous.camera != current.camera:
        raise InputError(
            f"the pictures of a pair are of two cameras, {previous.camera} and {current.camera}; "
            "give two of one camera"
        )


def _corners_blocked(movable: np.ndarray, side: int) -> tuple[bool, bool]:
    """Whether most of the lower left and the lower right square is no ground."""
    lowest = movable[-side:]
    return bool(lowest[:, :side].mean() < 127.5), bool(lowest[:, -side:].mean() < 127.5)


def _no_flows() -> Flows:
    return Flows(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.int32), np.zeros((0, 2)))
