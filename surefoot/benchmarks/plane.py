"""Floor plane among clutter, against Open3D's segment_plane and pyransac3d.

Ours searches 2048 points of the image and refines the plane on all of them. The hardest peer does the same with
Open3D: its search on 2048 points, evenly spaced, and two least-squares fits to all points near the plane.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from perception.depth import points
from perception.depth.points import Points
from perception.floor import choose
from perception.floor.prior import handheld_prior
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

from .benchmark import Benchmark, Comparison, mean_ratio, race

HEIGHT_M, TILT_RAD = 1.2, math.radians(25.0)
SIZES = ((320, 240), (640, 480))
BAND_M, TRIES = 0.01, 1000  # inlier distance and iterations of both peers
SCENES = 10  # for the errors
MOST_ERROR = {"deg": 0.018, "mm": 0.4}
SAMPLE = 2048  # points that ours searches


def scene(width: int, height: int, rng: np.random.Generator) -> tuple[Points, Plane]:
    """A floor seen from 1.2 m, with boxes and a wall on about 45 % of the image, and Kinect noise."""
    camera = Camera.from_view(width, height, math.radians(60.0), math.radians(47.0))
    pose = Pose3.from_rotation(head_rotation(0.0, TILT_RAD), np.array([0.0, 0.0, HEIGHT_M]))
    rays = camera.rays @ pose.rotation.T
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 2] < -1e-3, -HEIGHT_M / rays[..., 2], np.inf)
        z = np.minimum(z, 3.0 / rays[..., 0])  # a wall at 3 m
    for _ in range(5):
        u, v = rng.integers(0, width), rng.integers(height // 3, height)
        w, h = width // 6, height // 5
        front = float(rng.uniform(0.8, 1.4))
        z[v : v + h, u : u + w] = np.minimum(z[v : v + h, u : u + w], front)
    sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2
    noisy = (z + sigma * rng.standard_normal(z.shape)).astype(np.float32)
    depth = Depth(noisy, sigma.astype(np.float32), camera)
    true = Plane(np.array([0.0, 0.0, 1.0]), 0.0).moved(pose.inverse())
    return points.from_depth(depth, 0.2, 6.0), true


def run() -> Comparison:
    """77k and 307k points; ratios are geometric means over both, errors medians over ten scenes each."""
    rng = np.random.default_rng(0)
    has_peer = importlib.util.find_spec("pyransac3d") is not None
    times: dict[str, float] = {}
    ratios: dict[str, list[float]] = {}
    accuracy: dict[str, float] = {}
    for width, height in SIZES:
        cloud, _ = scene(width, height, rng)
        candidates: dict[str, Callable[[], object]] = {
            "ours": partial(choose.find, cloud, handheld_prior(None), rng),
            "open3d": partial(_open3d, _open3d_cloud(cloud.xyz)),
            "refit": partial(_refit, cloud.xyz),
        }
        if has_peer:
            candidates["pyransac3d"] = partial(_pyransac3d, cloud.xyz)
        taken = race(candidates, rounds=7)
        times |= {f"{name}_{width}x{height}_ms": value for name, value in taken.items()}
        for name, value in taken.items():
            if name != "ours":
                ratios.setdefault(f"ratio_{name}", []).append(value / taken["ours"])
        accuracy |= _errors(width, height, rng, has_peer)
    means = {name: mean_ratio(values) for name, values in ratios.items()}
    return Comparison(
        times,
        means,
        accuracy,
        {f"Open3D on {SAMPLE} points, refined on all": means["ratio_refit"]},
        ["PCL (no Python package)"] + ([] if has_peer else ["pyransac3d"]),
    )


def _errors(width: int, height: int, rng: np.random.Generator, has_peer: bool) -> dict[str, float]:
    """Median errors of each candidate at one size, and the ratio of ours to that of Open3D."""
    pairs: dict[str, list[tuple[float, float]]] = {}
    for _ in range(SCENES):
        cloud, true = scene(width, height, rng)
        found = choose.find(cloud, handheld_prior(None), rng)
        assert found is not None, "every scene has a visible floor"
        planes = {
            "ours": found.plane,
            "open3d": _open3d(_open3d_cloud(cloud.xyz)),
            "refit": _refit(cloud.xyz),
        }
        if has_peer:
            planes["pyransac3d"] = _pyransac3d(cloud.xyz)
        for name, plane in planes.items():
            pairs.setdefault(name, []).append(_error(plane, true))
    figures = {}
    for name, errors in pairs.items():
        angle, offset = np.median(np.array(errors), axis=0)
        figures[f"{name}_{width}x{height}_deg"] = float(angle)
        figures[f"{name}_{width}x{height}_mm"] = float(offset)
    for unit in ("deg", "mm"):
        ours, peer, refit = (
            figures[f"{name}_{width}x{height}_{unit}"] for name in ("ours", "open3d", "refit")
        )
        figures[f"error_share_{width}x{height}_{unit}"] = ours / peer
        figures[f"error_share_of_refit_{width}x{height}_{unit}"] = ours / refit
    return figures


def _open3d_cloud(xyz: Float[np.ndarray, "n 3"]) -> Any:
    import open3d as o3d

    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz))


def _open3d(cloud: Any) -> Plane:
    return _upward(cloud.segment_plane(BAND_M, 3, TRIES)[0])


def _refit(xyz: Float[np.ndarray, "n 3"]) -> Plane:
    """Open3D's plane of few points, then least squares on all points near it."""
    few = np.ascontiguousarray(xyz[:: max(1, len(xyz) // SAMPLE)])
    plane = _open3d(_open3d_cloud(few))
    for _ in range(2):
        near = xyz[np.abs(xyz @ plane.normal + plane.offset_m) < BAND_M]
        middle = near.mean(axis=0)
        away = near - middle
        normal = np.linalg.eigh(away.T @ away)[1][:, 0]
        plane = _upward([*normal, -normal @ middle])
    return plane


def _pyransac3d(xyz: Float[np.ndarray, "n 3"]) -> Plane:
    peer = importlib.import_module("pyransac3d")
    return _upward(peer.Plane().fit(xyz, BAND_M, TRIES)[0])


def _upward(equation: Any) -> Plane:
    """The plane a x + b y + c z + d = 0 with the camera on its positive side."""
    a, b, c, d = (float(value) for value in equation)
    length = math.copysign(math.sqrt(a * a + b * b + c * c), d)
    return Plane(np.array([a, b, c]) / length, d / length)


def _error(plane: Plane, true: Plane) -> tuple[float, float]:
    return math.degrees(plane.angle_to(true)), 1e3 * abs(plane.offset_m - true.offset_m)


BENCHMARK = Benchmark(
    "plane",
    "Floor plane in 77k and 307k points, 45 % clutter",
    run,
    {"ratio_open3d": 100.0, "ratio_pyransac3d": 50.0},
    {f"error_share_{w}x{h}_{unit}": 0.5 for w, h in SIZES for unit in ("deg", "mm")}
    | {f"ours_{w}x{h}_{unit}": most for w, h in SIZES for unit, most in MOST_ERROR.items()},
)
