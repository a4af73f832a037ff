"""Simulated views of staircases, and of ramps, kerbs and boxes, by three depth sensors; scene, camera pose and truth.

Staircases are seen from their foot or from their top. Steps are boxes; open ones are boards. The structured-light camera has
the field of view of a D435, with the noise of its kind and a bend as large as its maker states; the time-of-flight and the
stereo camera are those of the simulated robot. The errors of the head's joints are those of the walking study.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.depth import stereo, structured_light, time_of_flight
from perception.depth.distortion import DistortionConfig
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth, DepthView, RangeView, StereoView
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.scene import FloorArea, Scene, StaticObject
from sim.sensors.cameras import stereo_pair
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.shapes import Box, Shape, Solid
from sim.world import World

from ...config.schema import CALIBRATED_TOF
from .floor_views import BASELINE_M, CARTONS, FLOORINGS, JOINT_HEIGHT_M, JOINT_TILT_RAD, PAIR
from .simulated_depth import structured_light_sigma, true_depth

SENSORS = ("tof", "stereo", "depth")
D435 = Camera.from_view(640, 360, math.radians(87.0), math.radians(58.0))
EXTENT = (-0.2, -1.0, 3.2, 1.0)
WALL_M = 0.3  # low walls: painting takes most of the time
RISER_M, TREAD_M, STEPS = (0.10, 0.22), (0.22, 0.35), (3, 8)
HEIGHT_M = (0.45, 1.30)  # of the camera above the ground it stands on
AWAY_M = (0.4, 1.8)  # from the camera to the first edge
HIDDEN_M = 0.01  # of a riser behind the tread below it
BOARD_M = 0.04  # thickness of a step without riser
OPEN_SHARE = 0.25  # of the staircases that lead up
YAW_DEG, AIM_DEG, ROLL_DEG = 25.0, 8.0, 2.0
SLOPE_DEG = (4.0, 20.0)
KERB_M = (0.05, 0.20)
KINDS = ("up", "down", "ramp up", "ramp down", "flat", "kerb")


@dataclass(frozen=True)
class Stairs:
    """True staircase.

    Args:
        riser_m, tread_m, steps: Rise and going of a step, number of risers.
        direction: Unit vector in which it rises, camera frame, horizontal.
        first_edge: A point on the nearest edge, camera frame, m.
    """

    riser_m: float
    tread_m: float
    steps: int
    direction: Float[np.ndarray, "3"]
    first_edge: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class StairView:
    """One camera pose in one scene.

    Args:
        kind: One of `KINDS`.
        scene: What stands there.
        T_world_camera: True pose.
        prior: The ground below the camera by the joints, camera frame.
        ground: That ground, camera frame.
        away_m: Distance ahead to the first edge, or to the foot of a ramp.
        stairs: None where there is no staircase.
        slope_rad: Of the ramp; 0 without one.
    """

    kind: str
    scene: Scene
    T_world_camera: Pose3
    prior: Plane
    ground: Plane
    away_m: float
    stairs: Stairs | None
    slope_rad: float


def draw(seed: int, kind: str) -> StairView:
    """A random scene of a kind, and a camera before it."""
    rng = np.random.default_rng([seed, 41, KINDS.index(kind)])
    away, height = rng.uniform(*AWAY_M), rng.uniform(*HEIGHT_M)
    riser, tread = rng.uniform(*RISER_M), rng.uniform(*TREAD_M)
    steps = int(rng.integers(STEPS[0], STEPS[1] + 1))
    half = rng.uniform(0.5, 0.75)  # of the width
    slope = math.radians(rng.uniform(*SLOPE_DEG))
    closed = not (kind == "up" and rng.random() < OPEN_SHARE)
    kerb = rng.uniform(*KERB_M) * rng.choice([-1.0, 1.0])
    material = str(rng.choice(CARTONS))
    stand, aim = 0.0, np.array([away + 1.5 * tread, 0.0])  # ground below the camera; aim (x, z)
    parts: list[Shape] = []
    if kind == "up":
        for k in range(steps):
            start, end = away + k * tread, away + (k + 1) * tread + (0.8 if k + 1 == steps else 0.0)
            top = (k + 1) * riser
            thick = riser + HIDDEN_M if closed else BOARD_M
            parts.append(_block(start, end, half, top, thick, material))
        aim[1] = 1.5 * riser
    elif kind == "down":
        stand = steps * riser
        parts.append(_block(EXTENT[0], away, half + 0.2, stand, riser + HIDDEN_M, material))
        for k in range(1, steps):
            start, top = away + (k - 1) * tread, stand - k * riser
            parts.append(_block(start, start + tread, half + 0.2, top, riser + HIDDEN_M, material))
        aim[1] = stand - 1.5 * riser
    elif kind == "ramp up":
        parts.append(_wedge(away, away + 2.0, half, 0.0, 2.0 * math.tan(slope), material))
        aim[1] = 1.5 * tread * math.tan(slope)
    elif kind == "ramp down":
        stand = 2.0 * math.tan(slope)
        parts.append(_block(EXTENT[0], away, half + 0.2, stand, stand, material))
        parts.append(_wedge(away, away + 2.0, half + 0.2, stand, 0.0, material))
        aim[1] = stand - 1.5 * tread * math.tan(slope)
    elif kind == "kerb" and kerb > 0.0:
        parts.append(_block(away, EXTENT[2], EXTENT[3], kerb, kerb, material))
    elif kind == "kerb":
        stand = -kerb
        parts.append(_block(EXTENT[0], away, EXTENT[3], stand, stand, material))
    boxes: list[Shape] = []
    if kind in ("flat", "kerb", "ramp up"):
        boxes = _boxes(rng, away if kind == "flat" else 0.3, 2.6 if kind == "flat" else away)
    objects = [
        StaticObject(f"part {k}", (part,), float(rng.uniform(0.4, 0.8)))
        for k, part in enumerate((*parts, *boxes))
    ]
    area = (FloorArea(str(rng.choice(FLOORINGS)), EXTENT),)
    scene = Scene("stairs", seed, EXTENT, area, (*_walls(), *objects), (), (), Pose2(), ())
    T = _pose(rng, height + stand, aim)
    ground, prior = _floors(rng, T, stand)
    truth = None
    if kind in ("up", "down"):
        rises = np.array([1.0 if kind == "up" else -1.0, 0.0, 0.0])
        edge = np.array([away, 0.0, riser if kind == "up" else stand])
        truth = Stairs(riser, tread, steps, T.rotation.T @ rises, T.inverse().apply(edge))
    return StairView(
        kind, scene, T, prior, ground, away, truth, slope if kind.startswith("ramp") else 0.0
    )


def measure(view: StairView, seed: int) -> dict[str, Depth]:
    """The view by each of the sensors, with the noise of each."""
    rng = np.random.default_rng([seed, 42, KINDS.index(view.kind)])
    T = view.T_world_camera
    with World(view.scene) as world:
        left, right = stereo_pair(world, PAIR, BASELINE_M, T, rng)
        tof = TofCamera(TofConfig(), rng)
        measured, amplitude = tof.measure(world.ranges("rays"), T)
        z = true_depth(world, D435, T)
    return {
        "tof": time_of_flight.depth(RangeView(measured, amplitude, tof.camera), CALIBRATED_TOF),
        "stereo": stereo.depth(StereoView(left, right, BASELINE_M, PAIR.camera)),
        "depth": structured(z, np.random.default_rng([seed, 43, KINDS.index(view.kind)])),
    }


def structured(z: Float[np.ndarray, "h w"], rng: np.random.Generator) -> Depth:
    """Structured-light depth of a true one, m: noise, and a bend of the size that makers and literature state.

    The bend has the shapes and sizes of `depth.distortion`, which the claims are made of; so the NEES tests how they are
    carried to stairs, not whether sensors keep to them (that is `real-honesty`).
    """
    rays, seen = D435.rays, np.isfinite(z)
    sigma = structured_light_sigma(z)
    field = DistortionConfig().depth.field(
        rays[seen, 0], rays[seen, 1], z[seen], sigma[seen], float(rays[..., 0].max())
    )
    noisy = np.full(z.shape, np.nan)
    bend = field @ rng.standard_normal(field.shape[1])
    noisy[seen] = z[seen] * (1.0 + bend) + sigma[seen] * rng.standard_normal(bend.size)
    return structured_light.depth(DepthView(noisy.astype(np.float32), D435))


def _block(start: float, end: float, half: float, top: float, thick: float, material: str) -> Box:
    """A box between two places ahead, with its top at a height."""
    size = (end - start, 2.0 * half, thick)
    return Box(((start + end) / 2.0, 0.0, top - thick / 2.0), size, 0.0, material)


def _wedge(
    start: float, end: float, half: float, first: float, last: float, material: str
) -> Solid:
    """A ramp between two places ahead from one height to another, closed down to the floor."""
    near, far = max(first, 1e-3), max(last, 1e-3)
    vertices = np.array(
        [
            [x, y, z]
            for x, top in ((start, near), (end, far))
            for y in (-half, half)
            for z in (0.0, top)
        ]
    )  # 0-3 at the start: right low, right high, left low, left high; 4-7 at the end
    faces = ((0, 2, 6, 4), (1, 5, 7, 3), (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6))
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    return Solid(vertices, triangles, material)


def _boxes(rng: np.random.Generator, nearest: float, farthest: float) -> list[Shape]:
    """Two to five boxes on the floor."""
    found: list[Shape] = []
    for _ in range(int(rng.integers(2, 6))):
        size = rng.uniform((0.10, 0.10, 0.05), (0.40, 0.40, 0.40))
        x, y = rng.uniform(nearest, max(farthest, nearest + 0.1)), rng.uniform(-0.7, 0.7)
        yaw, material = rng.uniform(0.0, math.pi), str(rng.choice(CARTONS))
        found.append(Box((x, y, size[2] / 2), tuple(size), yaw, material))
    return found


def _pose(rng: np.random.Generator, height: float, aim: Float[np.ndarray, "2"]) -> Pose3:
    """A camera above the origin that looks about at a place (x, z)."""
    tilt = math.atan2(height - aim[1], aim[0]) + math.radians(rng.uniform(-AIM_DEG, AIM_DEG))
    pan, roll = math.radians(rng.uniform(-YAW_DEG, YAW_DEG)), math.radians(rng.normal(0, ROLL_DEG))
    c, s = math.cos(roll), math.sin(roll)
    rotation = head_rotation(pan, tilt) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Pose3.from_rotation(rotation, np.array([0.0, rng.uniform(-0.2, 0.2), height]))


def _floors(rng: np.random.Generator, T: Pose3, stand: float) -> tuple[Plane, Plane]:
    """The ground below the camera, and what the joints say of it."""
    true = Plane(np.array([0.0, 0.0, 1.0]), -stand).moved(T.inverse())
    a, b = JOINT_TILT_RAD * rng.normal(size=2)
    normal = true.normal + a * true.tangents[0] + b * true.tangents[1]
    normal /= np.linalg.norm(normal)
    sure = np.diag([JOINT_TILT_RAD**2, JOINT_TILT_RAD**2, JOINT_HEIGHT_M**2])
    return true, Plane(normal, true.offset_m + JOINT_HEIGHT_M * float(rng.normal()), sure)


def _walls() -> tuple[StaticObject, ...]:
    """Low walls to the left and the right."""
    x0, y0, x1, y1 = EXTENT
    middle, long = (x0 + x1) / 2, x1 - x0
    boxes = (
        Box((middle, y1 + 0.05, WALL_M / 2), (long, 0.10, WALL_M), 0.0, "wall/sage"),
        Box((middle, y0 - 0.05, WALL_M / 2), (long, 0.10, WALL_M), 0.0, "wall/cream"),
    )
    return tuple(StaticObject("wall", (box,), 0.75, wall=True) for box in boxes)
