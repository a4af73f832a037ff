"""Open3D's and small_gicp's alignment behind the signature of `alignment.align`, for comparison.

They take the same `Pyramid`s and return the same `Alignment`, evaluated by our measure, so one test finds the
slips of all. They use only the first initial pose.

Source: Steinbrücker et al. 2011, Park et al. 2017 (Open3D); Koide et al. 2024 (small_gicp).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from .alignment import AlignConfig, Alignment, align, evaluate
from .pyramid import Level, Pyramid

Aligner = Callable[[Pyramid, Pyramid, Sequence[Pose3], AlignConfig], Alignment | None]

ALIGNERS = ("surefoot", "open3d", "open3d-intensity", "open3d-depth", "small_gicp")
DEPTH_LIMIT_M = 6.0
JUMP_M = 0.07  # Open3D's default: a larger depth difference is an outlier
GICP_VOXEL_M = 0.03
GICP_REACH_M = 0.3


def aligner(name: str) -> Aligner:
    """The alignment of that name.

    Args:
        name: "surefoot"; "open3d" (hybrid of depth and grey), "open3d-intensity", "open3d-depth" (point to plane);
            "small_gicp".

    Raises:
        ConfigError: The name is unknown.
    """
    if name == "surefoot":
        return align
    if name == "small_gicp":
        return _small_gicp
    if name in ALIGNERS:
        method = {
            "open3d": "Hybrid",
            "open3d-intensity": "Intensity",
            "open3d-depth": "PointToPlane",
        }

        def by_open3d(
            target: Pyramid, source: Pyramid, starts: Sequence[Pose3], config: AlignConfig
        ) -> Alignment | None:
            return _open3d(target, source, starts, config, method[name])

        return by_open3d
    raise ConfigError(f"odometry: aligner={name!r} is unknown; choose one of {ALIGNERS}")


def _open3d(
    target: Pyramid, source: Pyramid, starts: Sequence[Pose3], config: AlignConfig, method: str
) -> Alignment | None:
    import open3d

    core: Any = open3d.core
    odometry: Any = open3d.t.pipelines.odometry
    to, of = target.levels[0], source.levels[0]
    criteria = [odometry.OdometryConvergenceCriteria(n) for n in (10, 5, 3)]  # Open3D's defaults
    try:
        found = odometry.rgbd_odometry_multi_scale(
            rgbd_image(of),
            rgbd_image(to),
            core.Tensor(to.camera.matrix),
            core.Tensor(starts[0].matrix),
            1.0,
            DEPTH_LIMIT_M,
            criteria,
            getattr(odometry.Method, method),
            odometry.OdometryLossParams(JUMP_M),
        )
    except RuntimeError:  # too few corresponding pixels
        return None
    return evaluate(target, source, found.transformation.numpy().copy(), config)


def rgbd_image(level: Level) -> Any:
    """A pyramid level as Open3D's RGB-D image, depth in m."""
    import open3d

    geometry: Any = open3d.t.geometry
    z = np.nan_to_num(level.z)[..., None]
    grey = level.grey if level.grey.shape == level.z.shape else np.zeros_like(level.z)
    light = np.repeat(grey[..., None] / np.float32(255.0), 3, axis=2)
    return geometry.RGBDImage(
        geometry.Image(np.ascontiguousarray(light.astype(np.float32))),
        geometry.Image(np.ascontiguousarray(z)),
    )


def _small_gicp(
    target: Pyramid, source: Pyramid, starts: Sequence[Pose3], config: AlignConfig
) -> Alignment | None:
    import small_gicp  # type: ignore[import-not-found, unused-ignore]

    library: Any = small_gicp
    clouds = [_cloud(pyramid.levels[0]) for pyramid in (target, source)]
    if min(len(cloud) for cloud in clouds) < 100:
        return None
    found = library.align(
        *clouds,
        init_T_target_source=starts[0].matrix,
        registration_type="GICP",
        downsampling_resolution=GICP_VOXEL_M,
        max_correspondence_distance=GICP_REACH_M,
        num_threads=1,
    )
    return evaluate(target, source, np.array(found.T_target_source), config)


def _cloud(level: Level) -> np.ndarray:
    x, y = level.slopes
    keep = np.isfinite(level.z)
    z = level.z.astype(np.float64)
    points = np.stack([x[None, :] * z, y[:, None] * z, z], axis=-1)
    return np.ascontiguousarray(points[keep])
