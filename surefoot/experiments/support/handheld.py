"""A camera carried through a simulated home: its path, its images with noise, and homes whose furniture was moved.

The camera goes along the paths between start and goals at eye level, looks from side to side, and turns about itself
at every goal. Depth is ray cast with the noise of structured light, colour is rendered.

Source: ours; noise: Nguyen, Izadi, Lovell 2012.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.primitives.camera import Camera
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3, head_rotation
from sim.free_space import ClearanceMap, clearance_map
from sim.scene import Place, Scene, StaticObject
from sim.shapes import Box, Cylinder, Shape, outline
from sim.world import World

from ...recordings.codec import encode
from ...recordings.mcap_format import RecordingWriter
from ...recordings.recording import RecordingInfo
from .simulated_depth import structured_light_sigma, true_depth

CAMERA = Camera(320, 240, 240.0, 240.0, 159.5, 119.5)
EYES_M, DOWN_RAD = 1.35, math.radians(30.0)
STEP_M, TURN_RAD = 0.4, math.radians(45.0)  # between two images
SWING_RAD, SWING_STEPS = math.radians(50.0), 9.0
FARTHEST_M = 5.0
DRIFT_M, DRIFT_RAD = 0.003, math.radians(0.1)  # of the reported poses, by each image
HZ = 10.0
SMALL = ("armchair", "coffee table", "plant", "pouf", "cartons", "chair", "bin")  # what people move
MOVED_M = (0.7, 3.0)  # nearest and farthest new place of a piece
GAP_M = 0.15  # around a piece at its new place
DRAWS = 400


@dataclass(frozen=True)
class Rearranged:
    """Two states of one home.

    Args:
        before, after: The home, without anything that moves by itself.
        old, new: Centres of the places that were left and filled, world frame, m; in the same order.
    """

    before: Scene
    after: Scene
    old: Float[np.ndarray, "n 2"]
    new: Float[np.ndarray, "n 2"]


def rearranged(scene: Scene, count: int, rng: np.random.Generator) -> Rearranged:
    """A home, and the same with some small pieces of furniture at other places.

    Args:
        scene: The home.
        count: Pieces to move; fewer if there are no more.
        rng: Draws pieces and places.
    """
    before = replace(scene, moving_objects=())
    movable = [k for k, one in enumerate(scene.static_objects) if one.name.startswith(SMALL)]
    objects = list(scene.static_objects)
    old: list[np.ndarray] = []
    new: list[np.ndarray] = []
    for k in rng.permutation(movable).tolist():
        if len(old) == count:
            break
        others = [part for n, one in enumerate(objects) if n != k for part in one.parts]
        piece, centre = objects[k], _centre(objects[k])
        reach = max(
            float(np.linalg.norm(outline(part) - centre, axis=1).max()) for part in piece.parts
        )
        space = clearance_map(scene.extent, others)
        for _ in range(DRAWS):
            away, towards = rng.uniform(*MOVED_M), rng.uniform(-math.pi, math.pi)
            place = centre + away * np.array([math.cos(towards), math.sin(towards)])
            taken = [np.linalg.norm(place - one) for one in (*old, *new)]
            x0, y0, x1, y1 = scene.extent
            inside = x0 < place[0] < x1 and y0 < place[1] < y1
            if (
                inside
                and space.at((place[0], place[1])) > reach + GAP_M
                and min(taken, default=9.0) > 0.6
            ):
                objects[k] = _moved(piece, centre, place, float(rng.uniform(-math.pi, math.pi)))
                old.append(centre)
                new.append(place)
                break
    after = replace(before, static_objects=tuple(objects))
    return Rearranged(before, after, np.array(old).reshape(-1, 2), np.array(new).reshape(-1, 2))


def _centre(piece: StaticObject) -> Float[np.ndarray, "2"]:
    """Middle of the rectangle around a piece, m."""
    corners = np.concatenate([outline(part) for part in piece.parts])
    return np.asarray((corners.min(axis=0) + corners.max(axis=0)) / 2.0)


def _moved(piece: StaticObject, centre: np.ndarray, place: np.ndarray, yaw: float) -> StaticObject:
    """A piece turned about its centre and set down at a place."""
    c, s = math.cos(yaw), math.sin(yaw)

    def part_moved(part: Shape) -> Shape:
        assert isinstance(part, (Box, Cylinder))  # furniture is made of these
        x, y = np.array(part.centre[:2]) - centre
        where = (place[0] + c * x - s * y, place[1] + s * x + c * y, part.centre[2])
        if isinstance(part, Box):
            return replace(part, centre=where, yaw_rad=part.yaw_rad + yaw)
        return replace(part, centre=where)

    return replace(piece, parts=tuple(part_moved(part) for part in piece.parts))


def path(scene: Scene, backwards: bool, most: int) -> list[Pose3]:
    """Poses of the camera along start and goals, at most so many; backwards: from the last goal to the start."""
    space = clearance_map(
        scene.extent, [part for one in scene.static_objects for part in one.parts]
    )
    start = (scene.start.x, scene.start.y)
    stops = [start, *((goal[0], goal[1]) for goal in scene.goals)]
    stops = stops[::-1] if backwards else stops
    poses: list[Pose3] = []
    heading = 0.0
    for one, other in zip(stops, [*stops[1:], None], strict=True):
        turns = round(2.0 * math.pi / TURN_RAD)
        poses += [_eyes(one, heading + k * TURN_RAD) for k in range(turns)]
        if other is not None:
            for place, along in _stretch(space, one, other):
                swing = SWING_RAD * math.sin(2.0 * math.pi * len(poses) / SWING_STEPS)
                poses += _turned(poses[-1], place, along + swing)
                heading = along + swing
    return poses[:most]


def _stretch(space: ClearanceMap, one: Place, other: Place) -> Iterator[tuple[Place, float]]:
    """Places every step along the path, and its direction there."""
    cells = next(
        (found for r in (0.3, 0.2, 0.1, 0.0) if (found := space.path(one, other, r)) is not None),
        np.array([one, other]),
    )
    smooth = np.stack(
        [
            np.convolve(np.pad(axis, 6, mode="edge"), np.full(13, 1 / 13), "valid")
            for axis in cells.T
        ],
        axis=1,
    )
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(smooth, axis=0), axis=1))])
    at = np.arange(0.0, lengths[-1], STEP_M)
    places = np.stack([np.interp(at, lengths, axis) for axis in smooth.T], axis=1)
    for k in range(1, len(places)):
        dx, dy = places[k] - places[k - 1]
        yield (float(places[k, 0]), float(places[k, 1])), math.atan2(dy, dx)


def _turned(last: Pose3, place: Place, heading: float) -> list[Pose3]:
    """Images from the last pose to a place and heading, none turned more than `TURN_RAD`."""
    ahead = last.rotation[:, 2]
    before = math.atan2(ahead[1], ahead[0])
    turn = (heading - before + math.pi) % (2.0 * math.pi) - math.pi
    count = max(1, math.ceil(abs(turn) / TURN_RAD))
    x0, y0 = last.translation[:2]
    shares = [(k + 1) / count for k in range(count)]
    return [
        _eyes((x0 + s * (place[0] - x0), y0 + s * (place[1] - y0)), before + s * turn)
        for s in shares
    ]


def _eyes(place: Place, heading: float) -> Pose3:
    return Pose3.from_rotation(head_rotation(heading, DOWN_RAD), np.array([*place, EYES_M]))


def drifted(poses: Sequence[Pose3], rng: np.random.Generator) -> list[Pose3]:
    """The poses as a tracking camera reports them: in axes of its own, with an error that grows from image to image."""
    turn = Rotation.from_rotvec([0.0, 0.0, float(rng.uniform(-math.pi, math.pi))]).as_matrix()
    axes = Pose3.from_rotation(turn, np.array([*rng.uniform(-5.0, 5.0, 2), 0.0]))
    found = [axes @ poses[0]]
    for before, after in pairwise(poses):
        shift, turned = rng.normal(0.0, DRIFT_M, 3), rng.normal(0.0, DRIFT_RAD, 3)
        noise = Pose3.from_rotation(Rotation.from_rotvec(turned).as_matrix(), shift)
        found.append(found[-1] @ before.inverse() @ after @ noise)
    return found


def frames(
    scene: Scene,
    poses: Sequence[Pose3],
    rng: np.random.Generator,
    told: Sequence[Pose3] | None = None,
) -> Iterator[Frame]:
    """Images of the camera at these poses, each with the pose that is told of it; None: the true one."""
    with World(scene) as world:
        for number, (pose, known) in enumerate(zip(poses, told or poses, strict=True)):
            z = true_depth(world, CAMERA, pose)
            with np.errstate(invalid="ignore"):
                z = z + structured_light_sigma(z) * rng.standard_normal(z.shape)
                z[~(z < FARTHEST_M)] = np.nan
            rgb = world.picture(CAMERA, pose)
            yield Frame(
                stamp_s=number / HZ,
                depth=DepthView(z.astype(np.float32), CAMERA),
                colour=ColourView(rgb, CAMERA),
                T_world_camera=known,
            )


def write_truth(path: Path, poses: Sequence[Pose3]) -> None:
    """Write the true poses of `frames` as TUM text."""
    rows = [(number / HZ, *pose.translation, *pose.quat_xyzw) for number, pose in enumerate(poses)]
    path.write_text("".join(" ".join(map(repr, row)) + "\n" for row in rows), encoding="utf-8")


def record(path: Path, name: str, seen: Iterator[Frame]) -> Path:
    """Write frames with their poses as a recording; returns its path."""
    info = RecordingInfo(name, "simulation", poses_given=True, gravity_up_world=(0.0, 0.0, 1.0))
    with RecordingWriter(path, info) as writer:
        for frame in seen:
            writer.write(encode(frame))
    return path
