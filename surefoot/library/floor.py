"""The floor in one depth image."""

from __future__ import annotations

import math

import numpy as np

from perception.depth import points
from perception.depth.points import Points
from perception.floor import choose
from perception.floor.choose import Floor, FloorConfig
from perception.floor.prior import handheld_prior, kinematic_prior
from perception.localisation.pose_source import PriorConfig
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3

from . import checks
from .checks import ArrayLike


def find_floor(
    depth_m: ArrayLike,
    camera: Camera,
    up: ArrayLike | None = None,
    T_body_camera: Pose3 | None = None,
    *,
    scale_per_metre: float | None = None,
    sigma_m: ArrayLike | None = None,
    nearest_m: float = 0.3,
    farthest_m: float = 4.0,
    calibrated: bool = False,
    sensor: str = "depth",
    seed: int = 0,
) -> Plane | None:
    """The floor in a depth image: a plane n.p + h = 0 with its covariance.

    Args:
        depth_m: (h, w), depth along the optical axis, m; NaN, 0 or negative where there is none. Integers
            need `scale_per_metre`.
        camera: Intrinsics; axes x right, y down, z ahead.
        up: (3,), direction that points up in the camera frame, of any length, to about 3 degrees (an
            accelerometer). None: the camera is held upright to about 25 degrees.
        T_body_camera: Camera in a body frame with z = 0 on the floor, to about 1 degree and 1 cm (joint
            angles). It replaces `up`, and finds floors of which little is visible.
        scale_per_metre: Units per metre of an integer image: 1000 for millimetres. 1 for floats in metres whose
            median is above 50 m.
        sigma_m: Standard deviation of the noise of each pixel alone, one number or (h, w), m. None: that of the
            sensor, or what the image shows if that is clearly more.
        nearest_m, farthest_m: Depths outside this range are not used.
        calibrated: Whether the depth hardly bends: it was rendered, or its bend is calibrated. The covariance then
            allows for a common error of 0.05 % + 0.05 % z/m of depth ("tof" 0.01 %, "stereo" a twentieth of sigma_m)
            instead of that of the sensor.
        sensor: "depth", structured light or active stereo: noise 1.2 mm + 1.9 mm (z - 0.4)^2, common error 1 % +
            0.5 % z/m; "tof", time of flight: noise 5 mm and 4 mm (z/1.3)^2 along the ray, common error 11 mm + 0.1 %,
            pixels between near and far things left out unless sigma_m is given; "stereo": common error as large as
            sigma_m, which it needs.
        seed: Of the random samples; equal seeds give equal planes.

    Returns:
        Plane in the camera frame: `normal` points up, `offset_m` is the camera's height over the floor in m,
        `covariance` is (3, 3) over (two tilts in rad, offset in m). None if no floor is found.

    Raises:
        InputError: The image has the wrong shape or type, or an argument is impossible.

    Source: seed 003, section 3, Fig. 4; Nguyen, Izadi, Lovell 2012 (noise).
    """
    depth = checks.depth_image(depth_m, camera, scale_per_metre, sigma_m, T_body_camera, sensor)
    reach = checks.reach(nearest_m, farthest_m)
    cloud = points.from_depth(depth, reach.nearest_m, reach.farthest_m)
    found = search(cloud, depth, up, seed, calibrated, sensor)
    return None if found is None else found.plane


def search(
    cloud: Points,
    depth: Depth,
    up: ArrayLike | None,
    seed: int,
    calibrated: bool = False,
    sensor: str = "depth",
) -> Floor | None:
    """The floor among the points of a checked image.

    Args:
        cloud: Points of the image.
        depth: The image.
        up, seed, calibrated, sensor: As for `find_floor`.
    """
    prior = expected(depth.T_body_camera, up)
    rng = np.random.default_rng(checks.whole(seed, "seed"))
    return choose.find(cloud, prior, rng, allowing(calibrated), sensor)


def allowing(calibrated: bool) -> FloorConfig:
    """The search that allows for the bend of consumer cameras, or for what a calibration leaves of it."""
    if not checks.flag(calibrated, "calibrated"):
        return FloorConfig()
    from ..config.schema import CALIBRATED_DISTORTION  # takes a second

    return FloorConfig(distortion=CALIBRATED_DISTORTION)


def expected(T_body_camera: Pose3 | None, up: ArrayLike | None) -> Plane:
    """The floor that joint angles, a direction, or neither let one expect, camera frame.

    Args:
        T_body_camera, up: As for `find_floor`.

    Raises:
        InputError: `up` is no direction.
    """
    mount = checks.optional(T_body_camera, Pose3, "T_body_camera")
    if mount is not None:
        config = PriorConfig()
        tilt = math.radians(config.joints_tilt_deg)
        return kinematic_prior(mount, tilt, config.joints_height_m)
    return handheld_prior(None if up is None else checks.direction(up, "up"))
