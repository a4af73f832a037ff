"""Obstacles in one depth image, and footprints in a point cloud."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mapping.objects import footprints
from mapping.objects.footprints import Footprint
from perception.depth import points
from perception.depth.flying import without_flying
from perception.depth.reach import ReachesConfig
from perception.floor import classify
from perception.floor.classify import ClassConfig
from perception.floor.levelling import camera_above_floor
from perception.floor.segmented_view import SegmentedView, lowermost, truncated, uppermost
from perception.obstacles import clustering
from perception.obstacles.clustering import Cluster
from perception.primitives.camera import Camera
from perception.primitives.plane import Plane

from . import checks
from .checks import ArrayLike
from .floor import search


def find_obstacles(
    depth_m: ArrayLike,
    camera: Camera,
    floor: Plane | None = None,
    *,
    up: ArrayLike | None = None,
    robot_height_m: float = 0.46,
    scale_per_metre: float | None = None,
    sigma_m: ArrayLike | None = None,
    nearest_m: float = 0.3,
    farthest_m: float = 4.0,
    baseline_m: float | None = None,
    sensor: str = "depth",
    seed: int = 0,
) -> list[Cluster] | None:
    """Objects that rise from the floor in a depth image, the nearest first.

    Positions are in the frame on the floor straight below the camera: x where the camera looks, y to the left,
    z up from the floor, m. Of an image of 160 columns or more every second row and column is used, as by `process`.

    Args:
        depth_m: (h, w), depth along the optical axis, m, as for `find_floor`.
        camera: Intrinsics.
        floor: The floor in the camera frame, as `find_floor` returns it; None searches it in this image.
        up: Direction that points up in the camera frame, for that search.
        robot_height_m: Points more than 0.1 m above this do not make an obstacle by themselves.
        scale_per_metre: Units per metre of an integer image.
        sigma_m: Standard deviation of depth, as for `find_floor`.
        nearest_m, farthest_m: Depths outside this range are not used.
        baseline_m: Distance of the cameras if a stereo pair measured the depth, as `stereo_depth` does, m. Objects
            that may go on where the pair has no depth are then not `placed`.
        sensor: "depth", "tof" or "stereo", as for `find_floor`.
        seed: Of the search for the floor.

    Returns:
        Clusters with `centre` (2,) and `covariance` (2, 2) of the covering disc, m and m^2, its `radius_m`,
        `height_m` above the floor, the number of its `points`, and the rectangle `footprint` of the visible part. Where `placed`
        is False the object is cut off by the image, by the range, by something nearer or by a hole, and its centre is
        only that of the visible part. An empty list if there are no obstacles; None if no floor is found.

    Raises:
        InputError: The image has the wrong shape or type, or an argument is impossible.

    Source: seed 003, section 3 (classes of points); clusters and their covariance are ours.
    """
    depth = checks.depth_image(depth_m, camera, scale_per_metre, sigma_m, sensor=sensor)
    if baseline_m is not None:
        depth = replace(depth, baseline_m=checks.positive(baseline_m, "baseline_m"))
    height_m = checks.positive(robot_height_m, "robot_height_m")
    stride = ReachesConfig().of(sensor, depth).stride
    reach = replace(checks.reach(nearest_m, farthest_m), stride=stride)
    cloud = points.from_depth(depth, reach.nearest_m, reach.farthest_m, stride)
    floor = plane = checks.optional(floor, Plane, "floor")
    if floor is None:
        found = search(cloud, depth, up, seed, sensor=sensor)
        if found is None:
            return None
        floor, plane = found.plane, found.among_points
    assert plane is not None
    cloud = without_flying(cloud, depth)
    config = ClassConfig(robot_height_m=height_m)
    classes = classify.classify(cloud, plane, config)
    T_floor_camera = camera_above_floor(floor)
    upright = T_floor_camera.apply(cloud.xyz)
    upright[:, 2] = floor.distance(cloud.xyz)
    view = SegmentedView(sensor, depth, cloud, classes, floor, None, T_floor_camera, upright)
    rising = view.rising
    return clustering.cluster(
        upright[rising],
        cloud.sigma[rising],
        np.zeros(2),
        truncated=truncated(view, cloud.of(rising), reach),
        uppermost=uppermost(view, cloud.of(rising)),
        lowermost=lowermost(view, cloud.of(rising), reach),
        sensor_height_m=floor.offset_m,
        pitch_rad=stride / camera.fy,
        rim_rad=clustering.rim_of(depth),
        top_m=config.top_m,
    )


def find_footprints(
    points_m: ArrayLike,
    sightings: ArrayLike | None = None,
    sensor_m: ArrayLike | None = None,
) -> list[Footprint]:
    """Outlines of the objects in a point cloud on the floor, those of most points first.

    Args:
        points_m: (n, 3), points of obstacles without the floor, z the height above it, m; best one point a voxel
            of about 2 cm. Rows with NaN are left out.
        sightings: (n,), integers, in how many images each point was seen; None if not known. Points seen once
            do not count where others were seen more often.
        sensor_m: (n, 2), where the camera stood when it saw each point; None if not known. It tells the outside of
            a box from the corner of a room: without it only what is seen from three sides is filled.

    Returns:
        Footprints with `outline` (k, 2), whether each side was `seen` and its `sigma_m`, `height_m`, and, where the
        object is a box, `box` with `centre`, `length_m`, `width_m` and `yaw_rad`; in the frame of the points.

    Raises:
        InputError: The points are not (n, 3) numbers, or there is not one number of sightings or one place a point.

    Source: ours.
    """
    cloud = checks.numbers(points_m, (None, 3), "points_m", finite=False)
    sensor = counts = None
    if sightings is not None and len(cloud):
        expected = f"({len(cloud)},) of integers"
        counts = checks.array(sightings, "sightings", expected, "ui", (1,))
        if len(counts) != len(cloud):
            raise checks.unfit("sightings", counts, expected)
    if sensor_m is not None:
        sensor = checks.numbers(sensor_m, (len(cloud), 2), "sensor_m", finite=False)
    return footprints.find(footprints.voxels_of(cloud, counts, sensor))
