"""One monocular cycle, in the order of the paper: ground, edges, flow, prediction, result image.

Source: Han 2018 (seed 000), section 5, steps 1 to 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from ..primitives.errors import ConfigError, InputError
from ..primitives.settings import setting
from . import pair_pose
from .adaptation import FloorColourModel
from .back_projection import FARTHEST_M, nearest_distance_m
from .contact_covariance import CameraNoise, CovarianceModel, prior_covariance
from .edges import find_edges
from .flow import BAND_PX, track_corners, track_floor
from .ground import ground_image
from .movable import predicted_image
from .obstacles import find_obstacles, floor_flows
from .result import Flows, MonocularResult, Picture

CORNER_PX = 20  # ours: side of the squares tested for S_m; 2.5 cm of floor


@dataclass(frozen=True)
class MonocularConfig:
    """The cycle of one camera."""

    use: str = setting(
        "auto",
        "",
        "when the pipeline looks for obstacles by colour: always, never, or auto (the planner needs it, or depth is lost)",
        "ours",
    )
    horizon_s: float = setting(
        0.65, "s", "time ahead of the predicted obstacles, T_DS + T_SS", "seed 000"
    )
    static_mps: float = setting(0.02, "m/s", "slower obstacles count as static", "seed 000")
    fastest_mps: float = setting(
        0.5,
        "m/s",
        "faster flows count as outliers; raise it where people walk",
        "ours: robots have 0.1, false matches 0.8 to 2",
    )
    farthest_m: float = setting(
        FARTHEST_M, "m", "d_max, maximum distance of contact points and flows", "seed 000"
    )
    least_floor_px: int = setting(
        500,
        "px",
        "smaller regions of floor that do not touch the bottom row are removed",
        "seed 000",
    )
    camera_noise: CameraNoise = field(default_factory=CameraNoise)  # set to 0 for exact poses

    def __post_init__(self) -> None:
        if self.use not in ("auto", "always", "never"):
            raise ConfigError(
                f"monocular: use={self.use!r} is unknown; choose auto, always or never"
            )
        for name in ("horizon_s", "static_mps"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"monocular: {name}={value} must be finite and not negative")
        for name in ("farthest_m", "fastest_mps"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"monocular: {name}={value} must be positive and finite")
        if self.least_floor_px < 0:
            raise ConfigError(
                f"monocular: least_floor_px={self.least_floor_px} must not be negative"
            )


class Monocular:
    """The monocular cycle; its state is the colour model of the floor."""

    def __init__(self, config: MonocularConfig) -> None:
        self.config = config
        self.colours = FloorColourModel()

    def cycle(
        self,
        previous: Picture | None,
        current: Picture,
        sway_world: Float[np.ndarray, "2"] | None = None,
    ) -> MonocularResult:
        """Process one pair of pictures.

        Args:
            previous: Taken at T_SS - dT; None for no optical flow (then all obstacles are static).
            current: Taken at T_SS.
            sway_world: Tilt between them by the gyro, see `pair_pose.estimate`; None without gyro.

        Returns:
            Its pictures have the camera poses that the texture of the floor corrected.

        Raises:
            InputError: The pictures are not in order of time, or not of one camera.
        """
        if previous is not None:
            _check(previous, current)
        config = self.config
        nearest_m = nearest_distance_m(current.camera, current.T_world_camera)
        if math.isfinite(nearest_m):  # the lowest row shows floor
            self.colours.learn(current.rgb, current.T_world_camera)
        ground = self._ground(current)
        edges = find_edges(ground)
        flows, errors = _no_flows(), prior_covariance(current, config.camera_noise)
        if previous is not None and edges.groups:
            before = self._ground(previous)
            tracks = track_floor(previous, current, before)
            pair = pair_pose.estimate(previous, current, *tracks, config.camera_noise, sway_world)
            previous, current, errors = pair.previous, pair.current, pair.covariance
            begin, end, doubt = track_corners(previous, current, before, ground)
            groups = edges.group_beside(end, float(BAND_PX))
            flows = floor_flows(begin, end, doubt, previous, current, groups, config.farthest_m)
        obstacles = find_obstacles(
            edges,
            flows,
            current,
            config.farthest_m,
            config.static_mps,
            config.fastest_mps,
            CovarianceModel(
                previous, current, config.horizon_s, errors, config.camera_noise.edge_px
            ),
        )
        predicted = predicted_image(ground, obstacles, current)
        movable = cv2.subtract(ground, predicted)
        return MonocularResult(
            previous=previous,
            current=current,
            ground=ground,
            edges=edges.image,
            flows=flows,
            obstacles=obstacles,
            predicted=predicted,
            movable=np.asarray(movable, dtype=np.uint8),
            horizon_s=config.horizon_s,
            nearest_m=nearest_m,
            corners_blocked=_corners_blocked(movable),
        )

    def _ground(self, picture: Picture) -> UInt8[np.ndarray, "h w"]:
        """I_g by the current colour model; empty while there is none."""
        colours = self.colours
        if colours.range is None:
            return np.zeros(picture.rgb.shape[:2], np.uint8)
        return ground_image(picture, colours.range, self.config.least_floor_px, colours.core)


def _check(previous: Picture, current: Picture) -> None:
    if not current.stamp_s > previous.stamp_s:
        raise InputError(
            f"the current picture, at {current.stamp_s} s, must be later than the previous one, "
            f"at {previous.stamp_s} s; swap them"
        )
    if previous.camera != current.camera:
        raise InputError(
            f"the pictures of a pair are from two cameras, {previous.camera} and {current.camera}; "
            "give two from one camera"
        )


def _corners_blocked(movable: np.ndarray) -> tuple[bool, bool]:
    """Whether most of the lower left and of the lower right square is not free."""
    lowest = movable[-CORNER_PX:]
    return bool(lowest[:, :CORNER_PX].mean() < 127.5), bool(lowest[:, -CORNER_PX:].mean() < 127.5)


def _no_flows() -> Flows:
    none = np.zeros((0, 2))
    return Flows(none, none, np.zeros((0, 2, 2)), np.zeros(0, np.int32), none)
