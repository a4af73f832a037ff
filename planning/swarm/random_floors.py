"""Random floor masks with a goal, for experiments, benchmarks and tests of the search.

Walls on three sides and upright cylinders, seen by one camera; a pixel is floor if its ray meets none of them. The masks
are exact, so that the search is judged apart from image processing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3, head_rotation

from .floor_rows import FloorRows

CAMERA = Camera.from_view(720, 720, math.radians(90.0), math.radians(90.0))  # seed 000
EYE_M = (0.05, 0.0, 0.383)  # of the simulated robot, head tilted down
TILT_DEG = 30.0  # seed 000


@dataclass(frozen=True, eq=False)
class RandomFloor:
    """One picture.

    Args:
        movable: Pixels of floor.
        camera, T_body_camera: The camera and its pose on the body.
        goal: Body frame, m.
    """

    movable: Bool[np.ndarray, "h w"]
    camera: Camera
    T_body_camera: Pose3
    goal: Float[np.ndarray, "2"]


def make(rng: np.random.Generator, camera: Camera = CAMERA) -> RandomFloor:
    """Two to nine cylinders of 8 to 60 cm across between walls, a goal up to 5 m ahead."""
    place = Pose3.from_rotation(head_rotation(0.0, math.radians(TILT_DEG)), np.array(EYE_M))
    rows = FloorRows.of(camera, place)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float64)
    floor = rows.floor_of(np.stack([u.ravel(), v.ravel()], axis=1))
    turn = float(rng.uniform(-0.6, 0.6))
    c, s = math.cos(turn), math.sin(turn)
    ahead, left = floor @ np.array([c, s]), floor @ np.array([-s, c])
    with np.errstate(invalid="ignore"):
        free = ahead < rng.uniform(1.2, 5.0)
        free &= (left < rng.uniform(0.4, 3.0)) & (left > -rng.uniform(0.4, 3.0))
        for _ in range(int(rng.integers(2, 10))):
            middle = np.array([rng.uniform(0.45, 3.0), rng.uniform(-1.2, 1.2)])
            radius, height = float(rng.uniform(0.04, 0.3)), float(rng.uniform(0.03, 0.3))
            free &= _gap(floor, np.array(EYE_M), middle, height) > radius
    goal = np.array([rng.uniform(0.2, 5.0), rng.uniform(-2.0, 2.0)])
    return RandomFloor(free.reshape(u.shape), camera, place, goal)


def _gap(floor: np.ndarray, eye: np.ndarray, middle: np.ndarray, height: float) -> np.ndarray:
    """Least distance of the rays to floor points from a vertical axis, below its top, m."""
    ray = eye[:2] - floor
    away = middle - floor
    share = (away * ray).sum(axis=1) / np.maximum((ray**2).sum(axis=1), 1e-12)
    share = np.clip(share, 0.0, height / eye[2])
    return np.asarray(np.hypot(*(away - share[:, None] * ray).T))
