"""Synthetic rooms: floor, boxes, table, wall, seen by a pinhole camera with known noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.depth.points import Points, from_depth
from perception.depth.structured_light import depth as structured_light
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth, DepthView
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

Box = tuple[float, float, float, float, float, float]  # x, y, z ranges in the body frame, m


@dataclass(frozen=True)
class Room:
    """What the camera measures and the ground truth."""

    depth: Depth
    points: Points
    floor: Plane
    height: np.ndarray  # (n,) true height of what each point belongs to, m
    T_body_camera: Pose3


def ray_box(origin: np.ndarray, rays: np.ndarray, box: Box) -> np.ndarray:
    """Ray parameter at which rays enter a box, inf where they miss (slab method)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low = (np.array(box[0::2]) - origin) / rays
        high = (np.array(box[1::2]) - origin) / rays
    enter = np.nanmax(np.minimum(low, high), axis=-1)
    leave = np.nanmin(np.maximum(low, high), axis=-1)
    return np.where((enter < leave) & (enter > 0), enter, np.inf)


def see(
    seed: int,
    height_m: float = 0.40,
    pitch_deg: float = 25.0,
    boxes: tuple[Box, ...] = (),
    wall_m: float = 6.0,
    with_floor: bool = True,
    noise: float = 1.0,
    scale: tuple[float, float, float] = (0.0, 0.0, 0.0),
    roll_deg: float = 0.0,
    size: tuple[int, int] = (160, 120),
    reach_m: float = 5.0,
) -> Room:
    """A view of a room; noise in parts of 1.2 mm + 1.9 mm (z - 0.4)^2, scale errors as in `refine`."""
    rng = np.random.default_rng(seed)
    camera = Camera.from_view(*size, np.radians(60.0), np.radians(47.0))
    c, s = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    rolled = head_rotation(0.0, np.radians(pitch_deg)) @ np.array(
        [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    )
    T = Pose3.from_rotation(rolled, np.array([0.0, 0.0, height_m]))
    rays = camera.rays @ T.rotation.T
    down = np.minimum(rays[..., 2], -1e-9)
    z = np.where(rays[..., 2] < -1e-9, -height_m / down, np.inf)
    if not with_floor:
        z[:] = np.inf
    z = np.minimum(z, wall_m / np.maximum(rays[..., 0], 1e-9))
    for box in boxes:
        z = np.minimum(z, ray_box(T.position, rays, box))
    true_height = height_m + z * rays[..., 2]
    sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2
    bent = z * (1.0 + scale[0] + scale[1] * camera.rays[..., 0] + scale[2] * camera.rays[..., 1])
    seen = bent + noise * rng.normal(size=z.shape) * sigma
    seen[z > reach_m] = np.nan
    depth = Depth(seen.astype(np.float32), sigma.astype(np.float32), camera, T)
    points = from_depth(depth, 0.1, reach_m)
    floor = Plane(np.array([0.0, 0.0, 1.0]), 0.0).moved(T.inverse())
    return Room(depth, points, floor, true_height.reshape(-1)[points.pixels], T)


@pytest.fixture(scope="session")
def look() -> Callable[..., Room]:
    """`see`, for tests."""
    return see


def known_floors(path: Path) -> dict[str, Plane]:
    """Planes of a floor.csv by frame name."""
    rows = [
        row.split(",") for row in path.read_text().splitlines() if not row.startswith(("#", "f"))
    ]
    rows += [
        row.split(",") for row in path.read_text().splitlines() if row.startswith("five_people")
    ]
    return {
        row[0]: Plane(np.array([float(v) for v in row[1:4]]), float(row[4]))
        for row in rows
        if row[0]
    }


def real_points(
    path: Path, camera: Camera, per_metre: float, nearest_m: float = 0.3, farthest_m: float = 4.0
) -> Points:
    """Every second row and column of a 16-bit depth image."""
    raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    z = np.where((raw == 0) | (raw == 65535), np.nan, raw / per_metre).astype(np.float32)
    return from_depth(structured_light(DepthView(z, camera)), nearest_m, farthest_m, 2)


@pytest.fixture(scope="session")
def read_points() -> Callable[..., Points]:
    """`real_points`, for tests."""
    return real_points


@pytest.fixture(scope="session")
def read_floors() -> Callable[[Path], dict[str, Plane]]:
    """`known_floors`, for tests."""
    return known_floors
