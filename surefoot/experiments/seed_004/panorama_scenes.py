"""Random things on a floor, looked at by a turning head: are they counted, and are the gaps between them right?

One to five boxes and round bins of any size and heading stand within reach, apart enough to be seen apart
from where the robot stands, and where the head's nine views show them. Nine views, encoders half a degree off, all errors of the camera. Counted is
what the panorama lists; a gap is the free width across the way between two neighbours.

Source: seed 004, section 2.3; the scenes are ours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mapping.panorama.obstacles import Surroundings
from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, stitch
from mapping.panorama.views import View, head_directions, view_of_depth
from perception.depth import time_of_flight
from perception.features.pictures import amplitude_picture
from perception.primitives.frame import RangeView
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.rendering.rays import RayCaster
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes.rooms import walls
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.shapes import Box, Cylinder, Shape, outline

from ...config.schema import CALIBRATED_TOF

ENCODER_DEG = 0.5  # deviation of pan and of tilt, each view on its own
CAMERA_HEIGHT_M = 0.55  # seed 004
LEVER_M = np.array([0.0, -0.035, 0.035])  # DARwIn-OP: camera about the neck, camera axes
EXTENT = (-0.8, -3.1, 3.6, 3.1)  # corners nearer than 5 m, where ranges would start again from 0
APART_RAD = math.radians(4.0)  # between neighbours, as seen from the robot
REACH_RAD = math.radians(55.0)  # a good deal less than the panorama's end
BLIND_RAD = math.radians(8.0)  # within it no view looks further down than 17.5 deg
NEAR_M, FAR_M = 0.7, 2.2


class Laid(NamedTuple):
    """A random thing: its shape, and where it lies as seen from the robot: azimuths and y, left first."""

    shape: Shape
    left_rad: float
    right_rad: float
    left_m: float
    right_m: float


def head(pan_rad: float, tilt_rad: float) -> Pose3:
    """The camera on a head so turned, above the origin of the body."""
    rotation = head_rotation(float(pan_rad), float(tilt_rad))
    return Pose3.from_rotation(rotation, np.array([0.0, 0.0, CAMERA_HEIGHT_M]) + rotation @ LEVER_M)


def nine_views(scene: Scene, rng: np.random.Generator) -> tuple[list[View], list[Pose3]]:
    """Views from where the robot starts, by encoders that are off, and their true poses on the body."""
    caster = RayCaster(scene)
    caster.place([mover.start for mover in scene.moving_objects])
    camera = TofCamera(TofConfig(), rng)
    views, true = [], []
    for number, (pan, tilt) in enumerate(head_directions()):
        off = math.radians(ENCODER_DEG) * rng.standard_normal(2)
        pose, prior = head(pan + off[0], tilt + off[1]), head(pan, tilt)
        range_m, amplitude = camera.measure(caster, scene.start.lifted() @ pose)
        view = RangeView(range_m, amplitude, camera.camera, prior)
        depth = time_of_flight.depth(view, CALIBRATED_TOF)
        views.append(view_of_depth(depth, 5.0, amplitude_picture(amplitude), prior, float(number)))
        true.append(pose)
    return views, true


def laid(shape: Shape) -> Laid:
    """A shape as it lies to a robot at the origin."""
    corners = outline(shape)
    azimuth = np.arctan2(corners[:, 1], corners[:, 0])
    return Laid(
        shape,
        float(azimuth.max()),
        float(azimuth.min()),
        float(corners[:, 1].max()),
        float(corners[:, 1].min()),
    )


def _draw(rng: np.random.Generator) -> Laid:
    bearing = rng.uniform(-0.8, 0.8) * REACH_RAD
    x = float(rng.uniform(NEAR_M, FAR_M))
    y, height = float(x * math.tan(bearing)), float(rng.uniform(0.15, 0.6))
    if rng.random() < 0.25:
        return laid(Cylinder((x, y, height / 2), float(rng.uniform(0.08, 0.25)), height))
    size = (float(rng.uniform(0.12, 0.45)), float(rng.uniform(0.12, 0.7)), height)
    return laid(Box((x, y, height / 2), size, float(rng.uniform(-math.pi, math.pi))))


def is_in_view(one: Laid) -> bool:
    """Whether nine views show a good part of it: straight ahead they look down less far than aside."""
    down = math.radians(15.0 if one.right_rad < BLIND_RAD and one.left_rad > -BLIND_RAD else 32.0)
    nearest = float(np.min(np.linalg.norm(outline(one.shape), axis=1)))
    return one.shape.top_m - 0.10 > CAMERA_HEIGHT_M - nearest * math.tan(down)


def random_things(rng: np.random.Generator) -> list[Laid]:
    """One to five things, from left to right, none in front of another."""
    wanted = int(rng.integers(1, 6))
    found: list[Laid] = []
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


def scene_of(things: list[Laid], rng: np.random.Generator) -> Scene:
    """A hall with nothing else in it."""
    shown = [
        StaticObject(f"thing {k + 1}", (one.shape,), float(rng.uniform(0.35, 0.9)))
        for k, one in enumerate(things)
    ]
    return Scene(
        "things",
        0,
        EXTENT,
        (FloorArea("planks/pine", EXTENT),),
        (*walls(EXTENT, ("wall/white",) * 4), *shown),
        (),
        (),
        Pose2(),
        ((2.0, 0.0),),
    )


class Score(NamedTuple):
    """One scene: things there and listed; error of each gap, m, and in deviations; errors of sizes, m."""

    things: int
    listed: int
    gaps_m: list[float]
    gaps_in_sigmas: list[float]
    widths_m: list[float]
    heights_m: list[float]


def look(seed: int) -> tuple[list[Laid], Panorama, list[View]]:
    """The random scene of a seed, and its panorama."""
    rng = np.random.default_rng([seed, 70])
    things = random_things(rng)
    views, _ = nine_views(scene_of(things, rng), rng)
    return things, stitch(views, rng), views


def score(seed: int) -> Score:
    """How the panorama of one random scene tells what is there."""
    things, panorama, views = look(seed)
    return compare(things, surroundings(panorama, views))


def compare(things: list[Laid], found: Surroundings) -> Score:
    """Truth against what was found; sizes and gaps only where the count is right."""
    empty = Score(len(things), len(found), [], [], [], [])
    if len(things) != len(found):
        return empty
    for k, gap in enumerate(found.gaps[1:-1]):
        true = things[k].right_m - things[k + 1].left_m
        empty.gaps_m.append(gap.width_m - true)
        empty.gaps_in_sigmas.append((gap.width_m - true) / gap.sigma_width_m)
    for one, obstacle in zip(things, found.obstacles, strict=True):
        empty.widths_m.append(obstacle.width_m - (one.left_m - one.right_m))
        empty.heights_m.append(obstacle.height_m - one.shape.top_m)
    return empty
