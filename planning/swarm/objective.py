"""The objective: the cost of a floor pixel as the next target.

The cost is the distance from the floor point of the pixel to the goal. Four conditions forbid a pixel: the footprint of
the robot there covers a blocked pixel (p1), the corridor from the feet to it does (p2), it lies on the side where an
obstacle has just left the picture beside the feet (p3), or the robot cannot turn to it in time (p4).

`literal` keeps the printed form, which does not work: penalties of 1 against a cost in metres (a pixel inside an obstacle
1.5 m nearer to the goal wins), a corridor that narrows to a point, and angles without the heading of the robot.

The corridor is free all over: the paper tests its two edges, 0.20 m apart, between which its robots of 7.4 cm fit.

Source: Han 2018 (seed 000), sections 4.2 to 4.6, eq. (3) to (9).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.pose import Pose2, Pose3, wrap_angle
from perception.primitives.robot_model import DARWIN_OP, GaitLimits, RobotModel
from perception.primitives.settings import setting

from . import _objective_kernels as kernels
from .floor_rows import FloorRows, upright


@dataclass(frozen=True)
class ObjectiveConfig:
    """Margins and limits of the search."""

    margin_m: float = setting(
        0.02, "m", "margin added to half the width and half the depth of the robot", "ours"
    )
    window_steps: int = setting(
        4, "", "N_step: steps within which the robot must be able to turn to a pixel", "seed 000"
    )
    farthest_m: float = setting(6.0, "m", "d_max: longest range of a target", "ours")
    top_share: float = setting(
        120.0 / 720.0, "", "share of the rows above the search", "seed 000: rows from 120 of 720 on"
    )
    penalty: float = 1e3  # ours: stands for infinity and keeps a slope for the swarm; seed 000: 1
    literal: bool = False  # as printed, with penalty 1

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
"""Eq. (4) to (9) as printed, for comparison."""


@dataclass(frozen=True, eq=False)
class Objective:
    """O over one picture; build it with `of`.

    Args:
        arrays: Picture, footprints and numbers of the view, for the kernels.
        floor: Geometry of the view.
        robot: Pose of the robot, world frame.
        config: Margins and limits.
    """

    arrays: kernels.Arrays
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
            movable: I_r: not 0 where the robot may walk.
            camera: Of the picture, rectified.
            T_body_camera: Its pose on the body. If the camera rolls, the picture is rotated upright first, and
                pixels are those of the upright picture.
            robot: Pose of the body, world frame.
            goal: World frame, m.
            config: Margins and limits.
            sides_blocked: Whether S_m forbids the left and the right half of the picture.
            model: Width, depth and gait of the robot.

        Raises:
            InputError: The picture does not have the size of the camera, or `FloorRows.of` refuses the camera.
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
        arrays = kernels.Arrays(
            blocked,
            cv2.integral(blocked, sdepth=cv2.CV_32S),
            rows,
            _footprints(floor, config, model),
            _geometry(floor, robot, goal, config, model, sides_blocked),
            config.penalty,
        )
        return Objective(arrays, floor, robot, config)

    def value(self, pixels: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """O of pixels (u, v), rounded, m; at least `config.penalty` for a forbidden one."""
        out = np.empty(len(pixels))
        kernels.values(self.arrays, np.ascontiguousarray(pixels, np.float64), out)
        return out

    def place(self, pixel: tuple[int, int]) -> Float[np.ndarray, "2"]:
        """Floor point of a pixel (u, v), world frame, m; NaN above the horizon."""
        return np.asarray(self.robot.apply(self.floor.floor_of(np.array([pixel], float)))[0])


def _footprints(floor: FloorRows, config: ObjectiveConfig, model: RobotModel) -> np.ndarray:
    """First row, end row, first and last column of the footprint at each row, px, see `kernels.Arrays.boxes`."""
    half_depth = model.depth_m / 2 + config.margin_m
    half_width = model.width_m / 2 + config.margin_m
    camera = floor.camera
    ahead = np.where(np.isfinite(floor.ahead), floor.ahead, 0.0)
    top = np.floor(floor.row_of(ahead + half_depth) + 0.5)
    top = np.maximum(top, np.argmax(np.isfinite(floor.ahead)))  # rounding may meet the horizon
    nearest = floor.row_of(ahead - half_depth)
    bottom = np.floor(nearest + 0.5)
    near = 1.0 / (camera.fx * np.maximum(floor.lines[2] + floor.lines[3] * nearest, 1e-9))
    room = near / np.nan_to_num(
        floor.per_px, nan=1.0
    )  # columns of its row per column at the near side
    first = np.ceil(camera.cx + (half_width / near - 0.5 - camera.cx) * room)
    last = np.floor(camera.cx + (camera.width - 0.5 - half_width / near - camera.cx) * room)
    limit = 4.0 * max(camera.height, camera.width)
    boxes = np.clip(np.stack([top, bottom + 1, first, last], axis=1), -1.0, limit)
    return boxes.astype(np.int64)


def _geometry(
    floor: FloorRows,
    robot: Pose2,
    goal: np.ndarray,
    config: ObjectiveConfig,
    model: RobotModel,
    sides_blocked: tuple[bool, bool],
) -> kernels.Geometry:
    camera, (x, y, up) = floor.camera, floor.eye
    in_body = robot.inverse().apply(np.asarray(goal, np.float64))
    ahead, left = Pose2(yaw=-floor.heading_rad).apply(in_body)
    window = config.window_rad(model.gait)
    turned = wrap_angle(robot.yaw - math.pi / 2) if config.literal else 0.0
    half = camera.width / 2
    p0, p1, q0, q1 = floor.lines.tolist()
    return kernels.Geometry(
        fx=float(camera.fx),
        fy=float(camera.fy),
        cx=float(camera.cx),
        cy=float(camera.cy),
        eye_ahead=float(x),
        eye_left=float(y),
        eye_up=float(up),
        tilt_sin=math.sin(floor.tilt_rad),
        tilt_cos=math.cos(floor.tilt_rad),
        p0=p0,
        p1=p1,
        q0=q0,
        q1=q1,
        half_m=model.width_m / 2 + config.margin_m,
        least_rad=-window,
        greatest_rad=window,
        goal_ahead=float(ahead),
        goal_left=float(left),
        first_column=half if sides_blocked[0] else 0.0,
        end_column=half if sides_blocked[1] else float(camera.width),
        farthest_m=config.farthest_m,
        first_row=config.top_share * camera.height,
        heading_rad=floor.heading_rad + turned,
        literal=config.literal,
    )
