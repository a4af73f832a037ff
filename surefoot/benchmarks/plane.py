"""Floor plane among clutter, against Open3D's segment_plane."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from perception import points
from perception.floor import choose
from perception.floor.prior import handheld_prior
from perception.points import Points
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

from .benchmark import Benchmark, Comparison, race

HEIGHT_M, TILT_RAD = 1.2, math.radians(25.0)


def scene(width: int, height: int, rng: np.random.Generator) -> tuple[Points, Plane]:
    """A floor seen from 1.2 m, boxes and a wall on about 45 % of the image, Kinect noise."""
    camera = Camera.from_view(width, height, math.radians(60.0), math.radians(47.0))
    pose = Pose3.from_rotation(head_rotation(0.0, TILT_RAD), np.array([0.0, 0.0, HEIGHT_M]))
    rays = camera.rays @ pose.rotation.T
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 2] < -1e-3, -HEIGHT_M / rays[..., 2], np.inf)
        z = np.minimum(z, 3.0 / rays[..., 0])  # a wall 3 m ahead
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
    """77k and 307k points; the ratio is the geometric mean, the errors are medians over ten scenes."""
    import open3d as o3d

    rng = np.random.default_rng(0)
    times: dict[str, float] = {}
    ratios = []
    for width, height in ((320, 240), (640, 480)):
        cloud, _ = scene(width, height, rng)
        peer = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.xyz))
        taken = race(
            {
                "ours": partial(choose.find, cloud, handheld_prior(None), rng),
                "open3d": partial(peer.segment_plane, 0.01, 3, 1000),
            },
            rounds=5,
        )
        times.update({f"{name}_{width}x{height}_ms": value for name, value in taken.items()})
        ratios.append(taken["open3d"] / taken["ours"])
    errors: dict[str, list[tuple[float, float]]] = {"ours": [], "open3d": []}
    for _ in range(10):
        cloud, true = scene(320, 240, rng)
        found = choose.find(cloud, handheld_prior(None), rng)
        assert found is not None, "the scene always shows its floor"
        errors["ours"].append(_error(found.plane, true))
        peer = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.xyz))
        a, b, c, d = peer.segment_plane(0.01, 3, 1000)[0]
        sign = math.copysign(1.0, float(np.array([a, b, c]) @ true.normal))
        errors["open3d"].append(_error(Plane(sign * np.array([a, b, c]), sign * d), true))
    accuracy = {}
    for name, pairs in errors.items():
        angle, offset = np.median(np.array(pairs), axis=0)
        accuracy[f"{name}_deg"], accuracy[f"{name}_mm"] = float(angle), float(offset)
    return Comparison(
        times,
        {"ratio_open3d": float(np.exp(np.mean(np.log(ratios))))},
        accuracy,
        ["PCL", "pyransac3d"],
    )


def _error(plane: Plane, true: Plane) -> tuple[float, float]:
    return math.degrees(plane.angle_to(true)), 1e3 * abs(plane.offset_m - true.offset_m)


BENCHMARK = Benchmark(
    "plane", "Floor plane in 77k and 307k points, 45 % clutter", run, {"ratio_open3d": 100.0}
)
