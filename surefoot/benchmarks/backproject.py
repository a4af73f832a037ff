"""Back-projection of whole depth images, against Open3D's tensor cloud and OpenCV's depthTo3d.

OpenCV's function is the hardest peer: it fills an array of points, since version 5 with a fourth coordinate 1.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import cv2
import numpy as np

from perception.depth import points
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth

from .benchmark import Benchmark, Comparison, mean_ratio, race

SIZES = ((176, 144), (320, 240), (640, 480))


def run() -> Comparison:
    """Three sizes; the ratio is the geometric mean over them."""
    import open3d as o3d

    times: dict[str, float] = {}
    ratios: dict[str, list[float]] = {"ratio_open3d": [], "ratio_depthto3d": []}
    worst = 0.0
    for width, height in SIZES:
        camera = Camera.from_view(width, height, np.radians(60.0), np.radians(47.0))
        rng = np.random.default_rng(0)
        z = rng.uniform(0.5, 4.0, (height, width)).astype(np.float32)
        depth = Depth(z, np.full_like(z, 0.01), camera)
        image = o3d.t.geometry.Image(np.ascontiguousarray(z[..., None]))
        taken = race(
            {
                "ours": partial(points.organised, depth),
                "open3d": partial(_open3d_points, image, camera),
                "depthto3d": partial(cv2.depthTo3d, z, camera.matrix),
            }
        )
        peer = _open3d_points(image, camera).point.positions.numpy().astype(np.float64)
        u, v = (
            np.rint(camera.project(peer)).astype(np.int64).T
        )  # the order of Open3D's points depends on its threads
        ours = points.organised(depth)
        worst = max(
            worst,
            float(np.max(np.abs(ours[v, u] - peer))),
            float(np.max(np.abs(ours - cv2.depthTo3d(z, camera.matrix)[..., :3]))),
        )
        times.update({f"{name}_{width}x{height}_ms": value for name, value in taken.items()})
        ratios["ratio_open3d"].append(taken["open3d"] / taken["ours"])
        ratios["ratio_depthto3d"].append(taken["depthto3d"] / taken["ours"])
    means = {name: mean_ratio(values) for name, values in ratios.items()}
    fair = {"OpenCV depthTo3d": means["ratio_depthto3d"]}
    return Comparison(times, means, {"largest_difference_m": worst}, fair)


def _open3d_points(image: Any, camera: Camera) -> Any:
    import open3d as o3d

    K: Any = o3d.core.Tensor
    return o3d.t.geometry.PointCloud.create_from_depth_image(
        image, K(camera.matrix), depth_scale=1.0, depth_max=10.0
    )


BENCHMARK = Benchmark(
    "backproject",
    "Depth image to points, 176x144 to 640x480",
    run,
    {"ratio_open3d": 8.0, "ratio_depthto3d": 2.5},
    {"largest_difference_m": 1e-5},  # single precision at 4 m
)
