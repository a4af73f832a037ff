"""Random objects on a floor in a panorama of nine views: are they all found, and are the gaps between them correct?

One to five boxes and round bins of random size and heading stand within range, separable from the robot's position and
inside the field of view of the nine views. Views have encoder errors of half a degree and all errors of the camera
model. The count is the number of obstacles that the panorama lists; a gap is the free lateral width between two
neighbours. A corner hidden behind the face of its own object bounds a gap from one side only.

Source: Kang 2013 (seed 004), section 2.3; the scenes are ours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mapping.panorama.obstacles import Surroundings
from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, stitch
from mapping.panorama.views import View, head_directions, view_of_depth
from perception.depth import time_of_flight
from perception.primitives.frame import RangeView
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.rendering.rays import RayCaster
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes.rooms import walls
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.shapes import Box, Cylinder, Shape, outline

from ...config.schema import CALIBRATED_TOF

ENCODER_DEG = 0.5  # standard deviation of pan and tilt, independent for each view
CAMERA_HEIGHT_M = 0.55  # seed 004
LEVER_M = np.array([0.0, -0.035, 0.035])  # DARwIn-OP: camera about the neck, camera axes
EXTENT = (-0.8, -3.1, 3.6, 3.1)  # corners nearer than 5 m, where ranges wrap
APART_RAD = math.radians(4.0)  # between neighbours, as seen from the robot
REACH_RAD = math.radians(55.0)  # well inside the panorama
BLIND_RAD = math.radians(8.0)  # within this azimuth no view looks further down than 17.5 deg
NEAR_M, FAR_M = 0.7, 2.2


class PlacedObject(NamedTuple):
    """An object: its shape, and the azimuths and y of its left and right ends as seen from the robot."""

    shape: Shape
    left_rad: float
    right_rad: float
    left_m: float
    right_m: float


def head_pose(pan_rad: float, tilt_rad: float) -> Pose3:
    """Camera pose above the body's origin at a pan and tilt."""
    rotation = head_rotation(float(pan_rad), float(tilt_rad))
    return Pose3.from_rotation(rotation, np.array([0.0, 0.0, CAMERA_HEIGHT_M]) + rotation @ LEVER_M)


def nine_views(
    scene: Scene, rng: np.random.Generator, encoder_deg: float = ENCODER_DEG
) -> tuple[list[View], list[Pose3]]:
    """Views at the robot's start with encoder errors of that standard deviation, and their true poses on the body."""
    caster = RayCaster(scene)
    caster.place([mover.start for mover in scene.moving_objects])
    camera = TofCamera(TofConfig(), rng)
    views, true = [], []
    for number, (pan, tilt) in enumerate(head_directions()):
        off = math.radians(encoder_deg) * rng.standard_normal(2)
        pose, prior = head_pose(pan + off[0], tilt + off[1]), head_pose(pan, tilt)
        range_m, amplitude = camera.measure(caster, scene.start.lifted() @ pose)
        view = RangeView(range_m, amplitude, camera.camera, prior)
        depth = time_of_flight.depth(view, CALIBRATED_TOF)
        views.append(view_of_depth(depth, 5.0, prior=prior, stamp_s=float(number)))
        true.append(pose)
    return views, true


def errors_deg(poses: list[Pose3], true: list[Pose3], aligned: bool) -> np.ndarray:
    """Angle between each rotation and the true one; if aligned, after removing the mean rotation."""
    between = Rotation.from_matrix(
        np.array([p.rotation @ t.rotation.T for p, t in zip(poses, true, strict=True)])
    )
    return np.degrees((between.mean().inv() * between if aligned else between).magnitude())


def placed(shape: Shape) -> PlacedObject:
    """A shape as seen by a robot at the origin."""
    corners = outline(shape)
    azimuth = np.arctan2(corners[:, 1], corners[:, 0])
    return PlacedObject(
        shape,
        float(azimuth.max()),
        float(azimuth.min()),
        float(corners[:, 1].max()),
        float(corners[:, 1].min()),
    )


def _draw(rng: np.random.Generator) -> PlacedObject:
    bearing = rng.uniform(-0.8, 0.8) * REACH_RAD
    x = float(rng.uniform(NEAR_M, FAR_M))
    y, height = float(x * math.tan(bearing)), float(rng.uniform(0.15, 0.6))
    if rng.random() < 0.25:
        return placed(Cylinder((x, y, height / 2), float(rng.uniform(0.08, 0.25)), height))
    size = (float(rng.uniform(0.12, 0.45)), float(rng.uniform(0.12, 0.7)), height)
    return placed(Box((x, y, height / 2), size, float(rng.uniform(-math.pi, math.pi))))


def is_in_view(one: PlacedObject) -> bool:
    """Whether the nine views show enough of an object: ahead they panorama_of down less than to the sides."""
    down = math.radians(15.0 if one.right_rad < BLIND_RAD and one.left_rad > -BLIND_RAD else 32.0)
    nearest = float(np.min(np.linalg.norm(outline(one.shape), axis=1)))
    return one.shape.top_m - 0.10 > CAMERA_HEIGHT_M - nearest * math.tan(down)


def random_objects(rng: np.random.Generator) -> list[PlacedObject]:
    """One to five objects from left to right, none occluding another."""
    wanted = int(rng.integers(1, 6))
    found: list[PlacedObject] = []
    for _ in range(200):
        one = _draw(rng)
        nearest = float(np.min(np.linalg.norm(outline(one.shape), axis=1)))
        corners = outline(one.shape)
        inside = nearest > 0.6 and is_in_view(one) and float(corners[:, 0].max()) < 2.45
        inside &= float(np.linalg.norm(corners, axis=1).max()) < 2.9
        inside &= max(abs(one.left_rad), abs(one.right_rad)) < REACH_RAD
        apart = all(
            one.right_rad > other.left_rad + APART_RAD or one.left_rad < other.right_rad - APART_RAD
            for other in found
        )
        if inside and apart:
            found.append(one)
        if len(found) == wanted:
            break
    return sorted(found, key=lambda one: -(one.left_rad + one.right_rad))


def scene_of(objects: list[PlacedObject], rng: np.random.Generator) -> Scene:
    """An empty hall with these objects."""
    shown = [
        StaticObject(f"object {k + 1}", (one.shape,), float(rng.uniform(0.35, 0.9)))
        for k, one in enumerate(objects)
    ]
    return Scene(
        "objects",
        0,
        EXTENT,
        (FloorArea("planks/pine", EXTENT),),
        (*walls(EXTENT, ("wall/white",) * 4), *shown),
        (),
        (),
        Pose2(),
        ((2.0, 0.0),),
    )


class GapError(NamedTuple):
    """A listed gap: listed less true width, m and in standard deviations, and whether both corners are seen."""

    error_m: float
    in_sigmas: float
    seen: bool


class Score(NamedTuple):
    """One scene: objects placed and listed; errors of the gaps; true widths of gaps not listed; size errors, m."""

    objects: int
    listed: int
    gaps: list[GapError]
    unlisted_m: list[float]
    widths_m: list[float]
    heights_m: list[float]


def panorama_of(seed: int) -> tuple[list[PlacedObject], Panorama, list[View]]:
    """The random scene of a seed, and its panorama."""
    rng = np.random.default_rng([seed, 70])
    objects = random_objects(rng)
    views, _ = nine_views(scene_of(objects, rng), rng)
    return objects, stitch(views, rng), views


def score(seed: int) -> Score:
    """Compare the panorama of one random scene with the truth."""
    objects, panorama, views = panorama_of(seed)
    return compare(objects, surroundings(panorama, views))


def compare(objects: list[PlacedObject], found: Surroundings) -> Score:
    """Compare true and listed objects; sizes and gaps only where the count is correct."""
    errors = Score(len(objects), len(found), [], [], [], [])
    if len(objects) != len(found):
        return errors
    listed = {(gap.left, gap.right): gap for gap in found.gaps}
    for k in range(len(objects) - 1):
        true, gap = objects[k].right_m - objects[k + 1].left_m, listed.get((k, k + 1))
        if gap is not None:
            error = gap.width_m - true
            seen = gap.corners_seen == 2
            errors.gaps.append(GapError(error, error / gap.sigma_width_m, seen))
        elif true > 0.0:
            errors.unlisted_m.append(true)
    for one, obstacle in zip(objects, found.obstacles, strict=True):
        errors.widths_m.append(obstacle.width_m - (one.left_m - one.right_m))
        errors.heights_m.append(obstacle.height_m - one.shape.top_m)
    return errors
