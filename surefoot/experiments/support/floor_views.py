"""Simulated views of a floor with boxes, for the experiments on floor planes: scene, camera pose and ground truth.

Every view has another head pose, floor texture and boxes. The errors of the head's joints are those measured in the
walking study, so the covariance of the prior is correct. The truth is ray cast into the rendered scene.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.depth.points import Points
from perception.floor.choose import Floor
from perception.floor.classify import FLOOR, classify
from perception.primitives.camera import Camera
from perception.primitives.frame import RangeView, StereoView
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.scene import FloorArea, Scene, StaticObject
from sim.sensors.cameras import ImageConfig, stereo_pair
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.shapes import Box
from sim.world import World

BASELINE_M = 0.04  # seed 003
PAIR = ImageConfig(640, 480, 60.0, (0.0, 0.0, 0.0))  # seed 003
EXTENT = (-0.3, -2.0, 3.6, 2.0)
WALL_M = 1.0  # low walls: rendering their texture takes most of the time
FLOORINGS = ("planks/oak", "planks/pine", "rug/teal", "rug/rust", "tiles/grey", "rug/navy")
CARTONS = ("cardboard/kraft", "fabric/mustard", "books/walnut", "wood/pine", "fabric/plum")
BOX_SHARE = (0.30, 0.40)  # seed 003, E1: about 35 % of the image
JOINT_TILT_RAD = math.radians(1.2)  # walking study: head roll .72, pitch .5 deg, joint offsets .3
JOINT_HEIGHT_M = 0.01
FLOOR_REACH_M = 3.0  # seed 003: floor reliable to 3 m
ON_FLOOR_M = 0.002


@dataclass(frozen=True)
class FloorView:
    """One camera pose.

    Args:
        T_world_camera: True pose; its projection on the floor is near the origin.
        prior: Floor plane by the joints, camera frame.
        floor: True floor plane, camera frame.
    """

    T_world_camera: Pose3
    prior: Plane
    floor: Plane


def random_view(
    rng: np.random.Generator,
    height_m: tuple[float, float],
    tilt_deg: tuple[float, float],
    pan_deg: float = 30.0,
) -> FloorView:
    """A random camera pose, and the floor plane that its joints report.

    Args:
        rng: Determines the pose and the joint errors.
        height_m: Least and greatest height of the camera.
        tilt_deg: Least and greatest downward tilt.
        pan_deg: Greatest pan to either side.
    """
    height, tilt = rng.uniform(*height_m), math.radians(rng.uniform(*tilt_deg))
    pan, roll = math.radians(rng.uniform(-pan_deg, pan_deg)), math.radians(rng.normal(0.0, 2.0))
    c, s = math.cos(roll), math.sin(roll)
    rotation = head_rotation(pan, tilt) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    T = Pose3.from_rotation(rotation, np.array([0.0, 0.0, height]))
    true = Plane(np.array([0.0, 0.0, 1.0]), 0.0).moved(T.inverse())
    a, b = JOINT_TILT_RAD * rng.normal(size=2)
    normal = true.normal + a * true.tangents[0] + b * true.tangents[1]
    normal /= np.linalg.norm(normal)
    sure = np.diag([JOINT_TILT_RAD**2, JOINT_TILT_RAD**2, JOINT_HEIGHT_M**2])
    lift = JOINT_HEIGHT_M * float(np.clip(rng.normal(), -2.5, 2.5))
    return FloorView(T, Plane(normal, true.offset_m + lift, sure), true)


def scene_with_boxes(view: FloorView, seed: int, rng: np.random.Generator) -> Scene:
    """A room with boxes that cover about 35 % of the image."""
    camera = Camera.from_view(
        80, 60, math.radians(60.0), 2 * math.atan(0.75 * math.tan(math.pi / 6))
    )
    flooring = str(rng.choice(FLOORINGS))
    boxes: list[StaticObject] = []
    ahead = view.T_world_camera.rotation[:, 2]
    heading = math.atan2(ahead[1], ahead[0])
    for _ in range(200):
        size = rng.uniform((0.10, 0.10, 0.06), (0.40, 0.40, 0.45))
        distance, bearing = rng.uniform(0.55, 2.6), rng.uniform(-0.55, 0.55)
        x, y = distance * math.cos(heading + bearing), distance * math.sin(heading + bearing)
        if not (EXTENT[0] < x < EXTENT[2] and EXTENT[1] < y < EXTENT[3]):
            continue
        box = Box(
            (x, y, size[2] / 2), tuple(size), rng.uniform(0.0, math.pi), str(rng.choice(CARTONS))
        )
        more = [
            *boxes,
            StaticObject(f"box {len(boxes) + 1}", (box,), float(rng.uniform(0.3, 0.8))),
        ]
        with World(_room(more, seed, flooring), "tiny") as world:
            height = true_height(world, camera, view.T_world_camera, inside=True)
        share = float(np.mean(height > ON_FLOOR_M))
        if share <= BOX_SHARE[1]:
            boxes = more
        if len(boxes) == len(more) and share >= BOX_SHARE[0]:
            break
    return _room(boxes, seed, flooring)


def _room(boxes: list[StaticObject], seed: int, flooring: str) -> Scene:
    area = (FloorArea(flooring, EXTENT),)
    return Scene("views", seed, EXTENT, area, _walls() + tuple(boxes), (), (), Pose2(), ())


def true_height(
    world: World, camera: Camera, T_world_camera: Pose3, inside: bool = False
) -> Float[np.ndarray, "h w"]:
    """Height of the surface that each pixel sees, m; with `inside`, walls have height 0."""
    rays = (camera.rays / np.linalg.norm(camera.rays, axis=-1, keepdims=True)).reshape(-1, 3)
    directions = (rays @ T_world_camera.rotation.T).astype(np.float32)
    hits = world.rays.cast(T_world_camera.position, directions)
    points = T_world_camera.position + hits.distance_m[:, None] * directions
    height = points[:, 2].copy()
    if inside:
        x0, y0, x1, y1 = EXTENT
        x, y = points[:, 0], points[:, 1]
        height[(x < x0 + 0.01) | (y < y0 + 0.01) | (x > x1 - 0.01) | (y > y1 - 0.01)] = 0.0
    return np.asarray(height.reshape(camera.height, camera.width), dtype=np.float64)


@dataclass(frozen=True)
class SensorViews:
    """Images of one view, and the true height of the surface that each pixel sees, m."""

    view: FloorView
    pair: StereoView
    range: RangeView
    pair_height: Float[np.ndarray, "h w"]
    range_height: Float[np.ndarray, "i j"]


def render(number: int) -> SensorViews:
    """Simulate one view with stereo and time of flight.

    Args:
        number: Seed of camera pose, floor, boxes and noise.
    """
    rng = np.random.default_rng([number, 31])
    view = random_view(rng, (0.30, 0.60), (15.0, 40.0))
    scene = scene_with_boxes(view, number, rng)
    with World(scene) as world:
        left, right = stereo_pair(world, PAIR, BASELINE_M, view.T_world_camera, rng)
        tof = TofCamera(TofConfig(), rng)
        measured, amplitude = tof.measure(world.ranges(), view.T_world_camera)
        return SensorViews(
            view,
            StereoView(left, right, BASELINE_M, PAIR.camera),
            RangeView(measured, amplitude, tof.camera),
            true_height(world, PAIR.camera, view.T_world_camera),
            true_height(world, tof.camera, view.T_world_camera),
        )


@dataclass(frozen=True)
class Score:
    """Comparison of one detected floor with the truth.

    Args:
        deg, mm: Errors of angle and height.
        nees: Normalised squared error of the plane per degree of freedom (3).
        claimed: Points classified as floor.
        correctly_claimed: Points classified as floor that are floor.
        floor: Points that are floor.
        milliseconds: Computing time.
    """

    deg: float
    mm: float
    nees: float
    claimed: int
    correctly_claimed: int
    floor: int
    milliseconds: float


def score(
    cloud: Points,
    found: Floor | None,
    view: FloorView,
    height: Float[np.ndarray, "h w"],
    milliseconds: float,
) -> Score | None:
    """Compare plane, covariance and classes of a floor with the truth; None if no floor was found."""
    if found is None:
        return None
    error = found.plane.error_to(view.floor)
    nees = float(error @ np.linalg.solve(found.plane.covariance, error)) / 3.0
    is_floor = np.abs(height.reshape(-1)[cloud.pixels]) < ON_FLOOR_M
    claimed = classify(cloud, found.among_points) == FLOOR
    return Score(
        math.degrees(found.plane.angle_to(view.floor)),
        1e3 * abs(float(error[2])),
        nees,
        int(claimed.sum()),
        int((claimed & is_floor).sum()),
        int(is_floor.sum()),
        milliseconds,
    )


def summary(name: str, scores: list[Score | None]) -> dict[str, float]:
    """Figures of one method over all views; precision and recall over all points of all views."""
    found = [one for one in scores if one is not None]
    if not found:
        return {f"{name}_floors_found_share": 0.0}
    deg, mm = np.array([s.deg for s in found]), np.array([s.mm for s in found])
    anees = float(np.mean([s.nees for s in found]))
    correct = sum(s.correctly_claimed for s in found)
    return {
        f"{name}_plane_deg_median": float(np.median(deg)),
        f"{name}_plane_deg_max": float(deg.max()),
        f"{name}_plane_mm_median": float(np.median(mm)),
        f"{name}_plane_mm_max": float(mm.max()),
        f"{name}_floor_precision": correct / max(sum(s.claimed for s in found), 1),
        f"{name}_floor_recall": correct / max(sum(s.floor for s in found), 1),
        f"{name}_plane_anees": anees,
        f"{name}_plane_anees_inverse": 1.0 / max(anees, 1e-9),
        f"{name}_floors_found_share": len(found) / len(scores),
        f"{name}_ms": float(np.median([s.milliseconds for s in found])),
    }


def _walls() -> tuple[StaticObject, ...]:
    """Three low walls: ahead, left and right."""
    x0, y0, x1, y1 = EXTENT
    middle = (x0 + x1) / 2
    boxes = (
        Box((x1 + 0.05, 0.0, WALL_M / 2), (0.10, y1 - y0 + 0.2, WALL_M), 0.0, "wall/white"),
        Box((middle, y1 + 0.05, WALL_M / 2), (x1 - x0, 0.10, WALL_M), 0.0, "wall/sage"),
        Box((middle, y0 - 0.05, WALL_M / 2), (x1 - x0, 0.10, WALL_M), 0.0, "wall/cream"),
    )
    return tuple(StaticObject("wall", (box,), 0.75, wall=True) for box in boxes)


COLUMNS = (
    "plane_deg_median",
    "plane_deg_max",
    "plane_mm_median",
    "plane_mm_max",
    "plane_anees",
    "floor_precision",
    "floor_recall",
    "ms",
)
HEADER = "deg median    max  mm median    max    NEES  precision  recall      ms"


def row(name: str, figures: dict[str, float]) -> str:
    """One method's figures of `summary` as a row below `HEADER`; nan if there are none."""
    v = [figures.get(f"{name}_{column}", math.nan) for column in COLUMNS]
    return (
        f"{v[0]:10.3f} {v[1]:6.3f} {v[2]:10.2f} {v[3]:6.2f} {v[4]:7.2f}"
        f"  {v[5]:9.4f} {v[6]:7.4f} {v[7]:7.1f}"
    )
