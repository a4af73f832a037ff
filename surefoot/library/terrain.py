"""Plane regions and stairs in one depth image."""

from __future__ import annotations

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3
from perception.terrain import segmentation, staircase
from perception.terrain.region import Region
from perception.terrain.staircase import Staircase

from . import checks
from .checks import ArrayLike
from .floor import allowing, expected


def find_regions(
    depth_m: ArrayLike,
    camera: Camera,
    *,
    scale_per_metre: float | None = None,
    sigma_m: ArrayLike | None = None,
    nearest_m: float = 0.3,
    farthest_m: float = 4.0,
    calibrated: bool = False,
    sensor: str = "depth",
) -> list[Region]:
    """Plane surfaces in a depth image: floors, treads, risers, ramps, walls; the one with most pixels first.

    Args:
        depth_m: (h, w), depth along the optical axis, m, as for `find_floor`.
        camera: Intrinsics; axes x right, y down, z ahead.
        scale_per_metre: Units per metre of an integer image: 1000 for millimetres.
        sigma_m: Standard deviation of the noise of each pixel alone, one number or (h, w), m. None: that of the
            sensor, as for `find_floor`.
        nearest_m, farthest_m: Depths outside this range are not used.
        calibrated: Whether the depth hardly bends, which makes the covariance smaller, as for `find_floor`.
        sensor: "depth", "tof" or "stereo", as for `find_floor`.

    Returns:
        Regions in the camera frame: `plane` with its covariance, `pixels` (n,) as flat indices and `mask(camera)`,
        `outline` (m, 3) in m, `edges` with `ends` (2, 3) in m, `kind` and `sigma_m`, and `slope_rad(up)`. Surfaces that
        the noise does not explain as one plane are left out; an empty list if there are none.

    Raises:
        InputError: The image has the wrong shape or type, or an argument is impossible.

    Source: ours, after Proenca and Gao 2018; Nguyen, Izadi, Lovell 2012 (noise).
    """
    depth = checks.depth_image(depth_m, camera, scale_per_metre, sigma_m, sensor=sensor)
    reach = checks.reach(nearest_m, farthest_m)
    return segmentation.find(depth, reach, allowing(calibrated), sensor)


def find_stairs(
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
) -> Staircase | None:
    """The staircase in a depth image, up or down: riser, tread, direction and first edge with their covariance.

    Args:
        depth_m: (h, w), depth along the optical axis, m, as for `find_floor`.
        camera: Intrinsics; axes x right, y down, z ahead.
        up: (3,), direction that points up in the camera frame, of any length, to about 3 degrees (an
            accelerometer).
        T_body_camera: Camera in a body frame with z = 0 on the floor, to about 1 degree (joint angles). It
            replaces `up`; one of the two is needed.
        scale_per_metre: Units per metre of an integer image: 1000 for millimetres.
        sigma_m: Standard deviation of the noise of each pixel alone, one number or (h, w), m. None: that of the
            sensor, as for `find_floor`.
        nearest_m, farthest_m: Depths outside this range are not used.
        calibrated: Whether the depth hardly bends, which makes the covariance smaller, as for `find_floor`.
        sensor: "depth", "tof" or "stereo", as for `find_floor`.

    Returns:
        Staircase in the camera frame: `riser_m`, `tread_m`, `steps` seen, unit vectors `direction` (in which it
        rises) and `up`, `first_edge` (3,) in m, `ascends` (away from the camera), and `covariance` (5, 5) over (riser,
        tread, yaw of the direction, distance of the first edge along it, height of the first edge), m and rad. None if
        no staircase is seen: a kerb, a ramp, boxes, or too few steps to be sure.

    Raises:
        InputError: The image has the wrong shape or type, an argument is impossible, or up is not known.

    Source: ours; Nguyen, Izadi, Lovell 2012 (noise).
    """
    if up is None and T_body_camera is None:
        raise InputError("find_stairs: which way is up must be known; give up or T_body_camera")
    prior = expected(T_body_camera, up)
    regions = find_regions(
        depth_m,
        camera,
        scale_per_metre=scale_per_metre,
        sigma_m=sigma_m,
        nearest_m=nearest_m,
        farthest_m=farthest_m,
        calibrated=calibrated,
        sensor=sensor,
    )
    return staircase.find(regions, prior)
