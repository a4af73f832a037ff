"""One moment of a run: what it estimated and intended at one time.

Values only; `moments` writes and reads them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from mapping.objects.footprints import Footprint
from perception.primitives.camera import Camera
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose3
from planning.gaze.selection import DirectionMap

UNKNOWN = 255
"""Value of a cell that was never seen, in `Layers.probability`."""

DRAWN = 0.15
"""Predictions of a lower weight are written, and not drawn."""


@dataclass(frozen=True, eq=False)
class Layers:
    """The terrain map round the robot; arrays [row, column], row 0 at the smallest y.

    Args:
        origin: Lower left corner of cell [0, 0], world frame, m.
        cell_m: Side of a cell.
        probability: That an obstacle stands there, times 254; `UNKNOWN` where never seen.
        confidence: How fresh the cell is, times 255.
        height_m: Of the surface above the floor, in steps of 1/256 m; NaN where not measured.
    """

    origin: Float[np.ndarray, "2"]
    cell_m: float
    probability: UInt8[np.ndarray, "rows columns"]
    confidence: UInt8[np.ndarray, "rows columns"]
    height_m: Float32[np.ndarray, "rows columns"]


@dataclass(frozen=True, eq=False)
class FloorSeen:
    """The floor below one camera, camera frame.

    Args:
        normal: Unit vector towards the camera's side.
        height_m: Of the camera above the floor.
        covariance: Of the tilt about two tangents and the height, rad and m.
        share: Of the points on the floor; 0 where the floor is only expected.
    """

    normal: Float[np.ndarray, "3"]
    height_m: float
    covariance: Float[np.ndarray, "3 3"]
    share: float


@dataclass(frozen=True, eq=False)
class Prediction:
    """One hypothesis on where a tracked obstacle will be.

    Args:
        seconds: From the moment on.
        weight: Probability of the hypothesis.
        mean: (x, y), world frame, m.
        covariance: Of it, m^2.
    """

    seconds: float
    weight: float
    mean: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]


@dataclass(frozen=True, eq=False)
class SurfaceSeen:
    """A surface of the ground on which a foot may stand.

    Args:
        corners: Of its outline, world frame; heights count from the ground of the start.
        borders: What is beyond the side from each corner to the next, values of `mapping.ground.surface.Border`.
    """

    corners: Float[np.ndarray, "n 3"]
    borders: Int[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Moment:
    """One moment of a run; world frame, m, rad, s.

    A field is None or empty where the run does not know it, or where this moment brings nothing new: pictures, grid, surfaces
    and footprints come at their own pace, the plan (steps to risk) with each decision, which has a `why`. Then the
    last one holds; `held` fills it in.

    Args:
        stamp_s: Time of the frame.
        pose: Gaussian over (x, y, yaw) of the body.
        cameras: T_world_camera of every sensor with an image in this frame.
        lenses: Intrinsics of the same sensors.
        head: Pan and tilt by the encoders, left and down positive.
        feet: Left and right: x, y, yaw, and 1 if lifted, else 0.
        steps: Next planned poses of the body, x, y, yaw, one a step; on several levels of the feet.
        route: Way points from the robot to the goal.
        goal: The present goal.
        gaze: Commanded pan and tilt.
        gaze_map: Worth of the directions, by which the gaze was chosen, in whole 255ths of the best.
        why: The planner's word for its decision; empty between decisions.
        status: What is doubted, in words.
        risk: Probability of contact with what may move, on the chosen plan, as the guard claims it.
        floor: By camera.
        grid: The terrain map.
        tracks: Tracked obstacles.
        predictions: Of each track, in the same order.
        footprints: Ground of the static obstacles; with the last moment.
        timing_ms: Wall time of every stage.
        colour: Camera picture, JPEG, at most 320 px wide.
        colour_sensor: Its camera: "colour", or "stereo" for the left one of a pair.
        depth: Depth along the axis, in steps of `depth_step_m`; 0: none. At most 320 px wide.
        depth_step_m: Unit of `depth`.
        depth_sensor: Sensor of `depth`.
        heights_m: Of the body frame, the left and the right sole above the ground of the start; None on one floor.
        height_sigma_m: Standard deviation of the first; None on one floor.
        surfaces: Of ground with several levels; None on one floor.
    """

    stamp_s: float
    pose: Gaussian | None = None
    cameras: dict[str, Pose3] = field(default_factory=dict)
    lenses: dict[str, Camera] = field(default_factory=dict)
    head: tuple[float, float] | None = None
    feet: Float[np.ndarray, "2 4"] | None = None
    steps: Float[np.ndarray, "n 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    route: Float[np.ndarray, "m 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    goal: Float[np.ndarray, "2"] | None = None
    gaze: tuple[float, float] | None = None
    gaze_map: DirectionMap | None = None
    why: str = ""
    status: tuple[str, ...] = ()
    risk: float | None = None
    floor: dict[str, FloorSeen] = field(default_factory=dict)
    grid: Layers | None = None
    tracks: tuple[Obstacle, ...] = ()
    predictions: tuple[tuple[Prediction, ...], ...] = ()
    footprints: tuple[Footprint, ...] | None = None
    timing_ms: dict[str, float] = field(default_factory=dict)
    colour: bytes | None = None
    colour_sensor: str = ""
    depth: UInt8[np.ndarray, "h w"] | None = None
    depth_step_m: float = 0.0
    depth_sensor: str = ""
    heights_m: Float[np.ndarray, "3"] | None = None
    height_sigma_m: float | None = None
    surfaces: tuple[SurfaceSeen, ...] | None = None
