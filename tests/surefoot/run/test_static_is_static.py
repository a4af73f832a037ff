"""Probability of moving in ray cast rooms of known motion: depth noise, partial views, wrong poses, occlusion."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView, Frame
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose3
from surefoot.config.schema import Config
from surefoot.recordings.recording import RecordingInfo
from surefoot.run.pipeline import Pipeline

CAMERA = Camera(160, 120, 140.0, 140.0, 79.5, 59.5)
STEP_S = 0.25
CLAIM = 0.5


class Box(NamedTuple):
    """An upright box or, if `round`, a cylinder, on the floor: centre, half sizes, bottom, top; m."""

    x: float
    y: float
    half_x: float
    half_y: float
    top: float
    bottom: float = 0.0
    round: bool = False


def cylinder(x: float, y: float, radius: float, top: float) -> Box:
    return Box(x, y, radius, radius, top, round=True)


def chair(x: float, y: float) -> list[Box]:
    legs = [Box(x + i, y + j, 0.02, 0.02, 0.42) for i in (-0.2, 0.2) for j in (-0.2, 0.2)]
    return [*legs, Box(x, y, 0.22, 0.22, 0.45, 0.42), Box(x + 0.2, y, 0.02, 0.22, 0.9, 0.45)]


ROOM = [
    Box(2.6, 0.0, 0.05, 3.0, 2.5),  # wall
    Box(0.1, 0.9, 0.25, 0.15, 0.5),
    Box(-0.3, -0.4, 0.10, 0.07, 0.12),
    cylinder(0.6, -0.7, 0.06, 0.8),
    cylinder(1.2, 0.3, 0.15, 0.4),
    *chair(1.2, -0.9),
]


def looking(eye: np.ndarray, at: np.ndarray) -> Pose3:
    """Pose of a camera (x right, y down, z ahead) in the world."""
    ahead = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return Pose3.from_rotation(np.column_stack([right, np.cross(ahead, right), ahead]), eye)


def depth_of(
    room: list[Box], pose: Pose3, rng: np.random.Generator, bend: float = 0.0
) -> np.ndarray:
    """Depth of a room with floor, with the noise of structured light (Nguyen 2012), m.

    `bend` is the relative error of depth in the corners of the image; it grows with the square of the distance from
    the middle.
    """
    rays = CAMERA.rays.reshape(-1, 3) @ pose.rotation.T
    eye = pose.position
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(rays[:, 2] < 0.0, -eye[2] / rays[:, 2], np.inf)
        for thing in room:
            z = np.minimum(z, _entered(thing, eye, rays))
    z[(z > 6.0) | (z < 0.3)] = np.nan
    z += (0.0012 + 0.0019 * (z - 0.4) ** 2) * rng.standard_normal(len(z))
    slopes = CAMERA.rays.reshape(-1, 3)[:, :2]
    z *= 1.0 + bend * np.sum(slopes**2, axis=1) / float(np.sum(slopes[0] ** 2))
    return z.reshape(CAMERA.height, CAMERA.width).astype(np.float32)


def _entered(thing: Box, eye: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Distance at which each ray enters a thing, in units of depth; infinite if it misses."""
    offset = eye - np.array([thing.x, thing.y, 0.0])
    low, high = sorted_pair(thing.bottom - eye[2], thing.top - eye[2], rays[:, 2])
    if thing.round:
        a = rays[:, 0] ** 2 + rays[:, 1] ** 2
        b = rays[:, :2] @ offset[:2]
        root = np.sqrt(b**2 - a * (offset[:2] @ offset[:2] - thing.half_x**2))
        low, high = np.fmax(low, (-b - root) / a), np.fmin(high, (-b + root) / a)
        low[np.isnan(root)] = np.inf
    else:
        for axis, half in ((0, thing.half_x), (1, thing.half_y)):
            near, far = sorted_pair(-half - offset[axis], half - offset[axis], rays[:, axis])
            low, high = np.fmax(low, near), np.fmin(high, far)
    return np.where((low < high) & (low > 0.0), low, np.inf)


def sorted_pair(first: float, second: float, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b = first / slope, second / slope
    return np.minimum(a, b), np.maximum(a, b)


def orbit(t: float) -> Pose3:
    """A camera carried slowly through 60 deg around the room at a height of 1.1 m."""
    angle = math.pi + 0.6 * math.sin(0.1 * t)
    eye = np.array([0.6 + 2.3 * math.cos(angle), 2.3 * math.sin(angle), 1.1])
    return looking(eye, np.array([0.6, 0.4 * math.sin(0.37 * t), 0.2]))


def still(_: float) -> Pose3:
    return looking(np.array([-1.6, 0.0, 1.1]), np.array([0.6, 0.0, 0.3]))


def process(
    room: Callable[[float], list[Box]],
    camera: Callable[[float], Pose3],
    seconds: float,
    seed: int = 0,
    pose_error: Callable[[float], np.ndarray] = lambda t: np.zeros(3),
    bend: float = 0.0,
) -> list[tuple[float, tuple[Obstacle, ...]]]:
    """Stamp and tracks of every frame, by the whole pipeline with given poses."""
    rng = np.random.default_rng(seed)
    info = RecordingInfo("room", "plain", poses_given=True, gravity_up_world=(0.0, 0.0, 1.0))
    pipeline, found = Pipeline(Config(), info), []
    for k in range(round(seconds / STEP_S)):
        t = k * STEP_S
        pose = camera(t)
        given = Pose3.from_rotation(pose.rotation, pose.position + pose_error(t))
        view = DepthView(depth_of(room(t), pose, rng, bend), CAMERA)
        world = pipeline.cycle(Frame(stamp_s=t, depth=view, T_world_camera=given))
        found.append((t, tuple(world.tracks)))
    return found


def claimed(found: list[tuple[float, tuple[Obstacle, ...]]]) -> set[int]:
    return {one.track for _, tracks in found for one in tracks if one.moving > CLAIM}


@pytest.mark.parametrize("bend", [0.0, -0.05])
def test_nothing_is_claimed_to_move_in_a_static_room_seen_from_a_moving_camera(bend):
    noise = np.random.default_rng(0).normal(0.0, 0.005, (200, 3)) * [1.0, 1.0, 0.0]
    found = process(lambda t: ROOM, orbit, 15.0, 0, lambda t: noise[round(t / STEP_S)], bend)
    assert max(len(tracks) for _, tracks in found) >= 3
    assert claimed(found) == set()


def test_a_bare_floor_of_a_bent_depth_image_has_no_obstacles():
    def bare(t: float) -> list[Box]:
        return []

    found = process(bare, orbit, 6.0, 1, bend=-0.05)
    assert [tracks for _, tracks in found if tracks] == []


@pytest.mark.parametrize(("jump_m", "seed"), [(0.06, 2), (0.2, 2), (0.2, 4), (0.2, 6)])
def test_a_jump_of_the_given_poses_makes_no_mover(jump_m, seed):
    found = process(
        lambda t: ROOM, orbit, 10.0, seed, lambda t: np.array([0.0, jump_m * (t > 5.0), 0.0])
    )
    assert claimed(found) == set()


def test_a_drift_of_the_given_poses_that_all_obstacles_share_makes_no_mover_at_the_end():
    room = [*ROOM, cylinder(0.9, -0.15, 0.06, 0.5)]
    found = process(lambda t: room, still, 10.0, 3, lambda t: np.array([0.0, 0.03 * t, 0.0]))
    _, tracks = found[-1]
    assert len(tracks) >= 3
    assert all(one.moving <= CLAIM for one in tracks)


@pytest.mark.parametrize("speed_mps", [0.05, 0.1])
def test_a_mover_is_found_before_it_has_travelled_three_of_its_radii(speed_mps):
    def room(t: float) -> list[Box]:
        return [*ROOM, cylinder(0.2, -0.1 + speed_mps * t, 0.1, 0.4)]

    found = process(room, still, 8.0)
    shown = {}
    for t, tracks in found:
        for one in tracks:
            near = math.dist(one.position.tolist(), (0.2, -0.1 + speed_mps * t)) < 0.1
            if near and one.moving > CLAIM:
                shown.setdefault(one.track, t)
    assert len(shown) == 1
    assert min(shown.values()) * speed_mps < 0.3
    assert claimed(found) == set(shown)


def test_a_passer_by_in_front_of_static_things_does_not_set_them_in_motion():
    def room(t: float) -> list[Box]:
        return [*ROOM, cylinder(-0.8, -1.2 + 0.4 * t, 0.15, 1.0)]

    places = np.array([[thing.x, thing.y] for thing in ROOM])
    static = [
        one
        for t, tracks in process(room, still, 7.0)
        for one in tracks
        if np.hypot(*(places - one.position).T).min() <= 0.25
        and math.dist(one.position.tolist(), (-0.8, -1.2 + 0.4 * t)) > 0.4
    ]
    assert len(static) > 40
    assert all(one.moving <= CLAIM for one in static)
