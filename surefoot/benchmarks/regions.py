"""Plane regions of a depth image of stairs, against Open3D's planar patches.

`detect_planar_patches` is the method of Araujo and Oliveira 2020 on a cloud whose normals are estimated first. Its hardest fair
form gets one point of sixteen, with a search radius that fits, and Open3D's own normals of these. It gives boxes, ours pixels,
edges and covariances as well. On so few points the peer misses the heights of the treads by more than a centimetre.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from perception.depth import points
from perception.depth.reach import ReachConfig
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3, head_rotation
from perception.terrain import segmentation

from .benchmark import Benchmark, Comparison, race

RISER_M, TREAD_M, AWAY_M, STEPS = 0.17, 0.28, 0.7, 4
HEIGHT_M, TILT_RAD = 1.2, math.radians(40.0)
NOISE_M = 0.003
REACH = ReachConfig(0.2, 4.0)
STRIDE = 4  # of rows and columns for the peer's quick form
NEIGHBOURS = 30  # Open3D's example
NEAR_M = 0.01  # a tread is found if a region or patch lies within this of its height


def scene() -> tuple[Depth, Pose3]:
    """Four steps ahead of a camera at the height of a head."""
    camera = Camera.from_view(640, 480, math.radians(70.0), math.radians(55.0))
    T = Pose3.from_rotation(head_rotation(0.2, TILT_RAD), np.array([0.0, 0.0, HEIGHT_M]))
    rays = camera.rays @ T.rotation.T
    z = np.full(rays.shape[:2], np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in range(STEPS + 1):
            start = AWAY_M + (k - 1) * TREAD_M if k else -math.inf
            end = start + TREAD_M if 0 < k < STEPS else (AWAY_M if k == 0 else math.inf)
            tread = (k * RISER_M - HEIGHT_M) / rays[..., 2]
            x = tread * rays[..., 0]
            z = np.where((tread > 0.0) & (x >= start) & (x < end), np.minimum(z, tread), z)
            riser = (AWAY_M + k * TREAD_M) / rays[..., 0]
            top = HEIGHT_M + riser * rays[..., 2]
            on = (riser > 0.0) & (top >= k * RISER_M) & (top < (k + 1) * RISER_M) & (k < STEPS)
            z = np.where(on, np.minimum(z, riser), z)
    z += NOISE_M * np.random.default_rng(0).standard_normal(z.shape)
    sigma = np.full(z.shape, NOISE_M, np.float32)
    return Depth(z.astype(np.float32), sigma, camera), T


def run() -> Comparison:
    """640 x 480 points; the share of treads that each finds, and its time."""
    depth, T = scene()
    whole, few = (_cloud(points.from_depth(depth, 0.2, 4.0, stride).xyz) for stride in (1, STRIDE))
    taken = race(
        {
            "ours": partial(segmentation.find, depth, REACH),
            "open3d": partial(_patches, whole),
            "open3d_few": partial(_patches, few),
        },
        rounds=5,
    )
    ours = [one.middle for one in segmentation.find(depth, REACH)]
    theirs = {
        name: [one.get_center() for one in _patches(c)]
        for name, c in (("open3d", whole), ("open3d_few", few))
    }
    accuracy = {"missed_ours": _missed(ours, T)}
    accuracy |= {f"missed_{name}": _missed(middles, T) for name, middles in theirs.items()}
    ratios = {f"ratio_{name}": taken[name] / taken["ours"] for name in theirs}
    return Comparison(
        {f"{name}_ms": value for name, value in taken.items()},
        ratios,
        accuracy,
        {f"Open3D on one point of {STRIDE * STRIDE}": ratios["ratio_open3d_few"]},
    )


def _missed(middles: list[Float[np.ndarray, "3"]], T: Pose3) -> float:
    """Share of the levels, the ground included, at whose height there is no region."""
    heights = [float(T.apply(np.asarray(one))[2]) for one in middles]
    levels = [k * RISER_M for k in range(STEPS + 1)]
    return float(
        np.mean([min((abs(h - one) for h in heights), default=9.0) > NEAR_M for one in levels])
    )


def _cloud(xyz: Float[np.ndarray, "n 3"]) -> Any:
    import open3d as o3d

    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz))


def _patches(cloud: Any) -> list[Any]:
    import open3d as o3d

    near = o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS)
    cloud.estimate_normals(near)
    return list(cloud.detect_planar_patches(search_param=near))


BENCHMARK = Benchmark(
    name="regions",
    title="Plane regions of stairs in a depth image of 640 x 480",
    run=run,
    bars={"ratio_open3d": 10.0},
    limits={"missed_ours": 0.0},
)
