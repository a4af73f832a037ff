"""The objective: how good a pixel of the floor is as the next place to walk to.

The cost is the distance from the pixel's floor point to the goal. Four things forbid a pixel: the robot's
footprint there touches what cannot be walked on (p1), an edge of the corridor from the feet to it does
(p2), it lies on the side where an obstacle has just been lost from sight beside the feet (p3), or the
robot would have to turn farther than it can before it gets there (p4).

What is printed and does not work exists as `literal`: penalties of 1 against a cost in metres (a pixel
inside an obstacle 1.5 m nearer the goal wins), a corridor that narrows to a point, angles that forget the
robot's own heading.

Source: seed 000, sections 4.2 to 4.6, eq. (3) to (9).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.pose import Pose2, Pose3, wrap_angle
from perception.primitives.robot_model import DARWIN_OP, GaitLimits, RobotModel

from . import _objective_kernels
from .floor_rows import FloorRows, upright


@dataclass(frozen=True)
class ObjectiveConfig:
    """The robot's measures and the limits of the search."""

    margin_m: float = 0.02  # own (specification): added to both half measures
    window_steps: int = 4  # N_step, seed 000: the window is theta_safety N_step to both sides
    farthest_m: float = 6.0  # d_max, own (specification)
    top_share: float = 120.0 / 720.0  # seed 000: rows from 120 of 720 on
    penalty: float = 1e3  # ours, for infinity: keeps a slope for the swarm; seed 000 prints 1
    inside: bool = (
        True  # ours: nothing between the edges of the corridor either; seed 000: its edges
    )
    literal: bool = False  # as printed: narrowing corridor, absolute angles; with penalty 1

    def __post_init__(self) -> None:
        for name in ("farthest_m", "penalty"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"swarm: {name}={value} must be positive and finite")
        if self.window_steps < 1:
            raise ConfigError(f"swarm: window_steps={self.window_steps} must be at least 1")
        if not 0.0 <= self.top_share < 1.0:
            raise ConfigError(f"swarm: top_share={self.top_share} must lie in [0, 1)")
        if not (math.isfinite(self.margin_m) and self.margin_m >= 0.0):
            raise ConfigError(f"swarm: margin_m={self.margin_m} must be finite and not negative")

    def window_rad(self, gait: GaitLimits) -> float:
        """Largest angle between the heading and a pixel, p4: what the robot can turn within the steps."""
        return gait.max_turn_rad * self.window_steps


PRINTED = ObjectiveConfig(margin_m=0.0, penalty=1.0, literal=True)
"""Eq. (4) to (9) as they are printed, for comparison."""


@dataclass(frozen=True, eq=False)
class Objective:
    """O over one result image; build it with `of`.

    Args:
        blocked: Pixels that cannot be walked on.
        integral: Their count above and left of each corner.
        rows: (ahead, metres per column) of each row; ahead is -1 where there is no floor.
        boxes: (first row, end row, half width) of the robot's footprint at each row, px.
        packed: See `_objective_kernels`.
        floor: Geometry of the view.
        robot: Where the robot stands, world frame.
        config: Measures and limits.
    """

    blocked: UInt8[np.ndarray, "h w"]
    integral: Int[np.ndarray, "h1 w1"]
    rows: Float[np.ndarray, "h 2"]
    boxes: Int[np.ndarray, "h 3"]
    packed: Float[np.ndarray, "25"]
    floor: FloorRows
    robot: Pose2
    config: ObjectiveConfig

    @staticmethod
    def of(
        movable: UInt8[np.ndarray, "h w"] | Bool[np.ndarray, "h w"],
        camera: Camera,
        T_body_camera: Pose3,
        robot: Pose2,
        goal: Float[np.ndarray, "2"],
        config: ObjectiveConfig,
        sides_blocked: tuple[bool, bool] = (False, False),
        model: RobotModel = DARWIN_OP,
    ) -> Objective:
        """Prepare the objective for one picture.

        Args:
            movable: I_r: not 0 where the floor may be walked on.
            camera: Of the picture, rectified.
            T_body_camera: Its place on the body. If it leans, the picture is turned upright first, and
                pixels are those of the upright picture from then on.
            robot: Pose of the body, world frame.
            goal: World frame, m.
            config: Limits.
            sides_blocked: Whether S_m forbids the left and the right half of the picture.
            model: Width, depth and gait of the robot.

        Raises:
            InputError: for a picture that is not the camera's, or a camera as `FloorRows.of` refuses.
        """
        if movable.shape != (camera.height, camera.width):
            raise InputError(
                f"swarm: the result image is {movable.shape[1]}x{movable.shape[0]} px, the camera "
                f"{camera.width}x{camera.height}; give the camera of that image"
            )
        floor = FloorRows.of(camera, T_body_camera)
        standing = upright(movable.view(np.uint8), camera, T_body_camera)
        blocked = (standing == 0).view(np.uint8)
        rows = np.stack([floor.ahead, floor.per_px], axis=1)
        rows[~np.isfinite(rows[:, 0])] = -1.0
        return Objective(
            blocked,
            cv2.integral(blocked, sdepth=cv2.CV_32S),
            rows,
            _footprints(floor, config, model),
            _pack(floor, robot, goal, config, model, sides_blocked),
            floor,
            robot,
            config,
        )

    def value(self, pixels: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """O of pixels (u, v), rounded to whole ones: metres, or at least `config.penalty` if forbidden."""
        out = np.empty(len(pixels))
        _objective_kernels.values(*self.arrays, np.ascontiguousarray(pixels, np.float64), out)
        return out

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
        """Blocked pixels, their integral, rows, boxes, the packed numbers and the penalty: what the loops take."""
        return (
            self.blocked,
            self.integral,
            self.rows,
            self.boxes,
            self.packed,
            self.config.penalty,
        )

    def place(self, pixel: tuple[int, int]) -> Float[np.ndarray, "2"]:
        """Floor point of a pixel (u, v), world frame, m; NaN above the horizon."""
        return np.asarray(self.robot.apply(self.floor.floor_of(np.array([pixel], float)))[0])


def _footprints(floor: FloorRows, config: ObjectiveConfig, model: RobotModel) -> np.ndarray:
    """Rows and half width that cover the image of the robot's rectangle about each row's floor."""
    half_depth = model.depth_m / 2 + config.margin_m
    half_width = model.width_m / 2 + config.margin_m
    ahead = np.where(np.isfinite(floor.ahead), floor.ahead, 0.0)
    top = np.floor(floor.row_of(ahead + half_depth) + 0.5)
    bottom = np.floor(floor.row_of(ahead - half_depth) + 0.5)
    inside = np.clip(bottom, 0, floor.camera.height - 1).astype(np.intp)
    per_px = floor.per_px[inside]
    half = np.where(np.isfinite(per_px), np.ceil(half_width / np.nan_to_num(per_px, nan=1.0)), 0.0)
    limit = 4.0 * floor.camera.height
    boxes = np.clip(np.stack([top, bottom + 1, half], axis=1), -1.0, limit)
    return boxes.astype(np.int64)


def _pack(
    floor: FloorRows,
    robot: Pose2,
    goal: np.ndarray,
    config: ObjectiveConfig,
    model: RobotModel,
    sides_blocked: tuple[bool, bool],
) -> np.ndarray:
    camera, (x, y, up) = floor.camera, floor.eye
    in_body = robot.inverse().apply(np.asarray(goal, np.float64))
    ahead, left = Pose2(yaw=-floor.heading_rad).apply(in_body)
    window = config.window_rad(model.gait)
    turned = wrap_angle(robot.yaw - math.pi / 2) if config.literal else 0.0
    half = camera.width / 2
    first, end = (
        half if sides_blocked[0] else 0.0,
        half if sides_blocked[1] else float(camera.width),
    )
    return np.array(
        [
            camera.fx,
            camera.cx,
            y,
            *floor.lines,
            model.width_m / 2 + config.margin_m,
            -window,
            window,
            math.sin(floor.tilt_rad),
            math.cos(floor.tilt_rad),
            x,
            up,
            camera.fy,
            camera.cy,
            ahead,
            left,
            first,
            end,
            config.farthest_m,
            config.top_share * camera.height,
            float(config.literal),
            floor.heading_rad + turned,
            float(config.inside),
        ]
    )
