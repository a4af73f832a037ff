"""Open3D's and small_gicp's alignment behind the signature of `alignment.align`, for comparison.

They take the same `Pyramid`s and return the same `Alignment`, evaluated by our measure, so one test finds the
slips of all. They use only the first initial pose.

Source: Steinbrücker et al. 2011, Park et al. 2017 (Open3D); Koide et al. 2024 (small_gicp).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

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
            return _open3d(target, source, starts, method[name])

        return by_open3d
    raise ConfigError(f"odometry: aligner={name!r} is unknown; choose {', '.join(ALIGNERS)}")


def _open3d(
    target: Pyramid, source: Pyramid, starts: Sequence[Pose3], method: str
) -> Alignment | None:
    found = open3d_motion(target.levels[0], source.levels[0], starts[0], method)
    return None if found is None else evaluate(target, source, found)


def open3d_motion(
    target: Level, source: Level, start: Pose3, method: str = "Hybrid"
) -> Float[np.ndarray, "4 4"] | None:
    """T_target_source by Open3D's RGB-D odometry; None if too few pixels correspond.

    Args:
        target, source: Images at full resolution.
        start: Initial value.
        method: "Hybrid", "Intensity" or "PointToPlane".
    """
    import open3d

    core: Any = open3d.core
    odometry: Any = open3d.t.pipelines.odometry
    criteria = [odometry.OdometryConvergenceCriteria(n) for n in (10, 5, 3)]  # Open3D's defaults
    try:
        found = odometry.rgbd_odometry_multi_scale(
            rgbd_image(source),
            rgbd_image(target),
            core.Tensor(target.camera.matrix),
            core.Tensor(start.matrix),
            1.0,
            DEPTH_LIMIT_M,
            criteria,
            getattr(odometry.Method, method),
            odometry.OdometryLossParams(JUMP_M),
        )
    except RuntimeError:  # too few corresponding pixels
        return None
    return np.asarray(found.transformation.numpy().copy())


def open3d_covariance(
    target: Level, source: Level, T: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "6 6"] | None:
    """Covariance of a motion by the information matrix that Open3D's pose graphs take; as `Alignment.covariance`."""
    import open3d

    core: Any = open3d.core
    found = open3d.t.pipelines.odometry.compute_odometry_information_matrix(
        rgbd_image(source).depth,
        rgbd_image(target).depth,
        core.Tensor(target.camera.matrix),
        core.Tensor(T),
        JUMP_M,
        1.0,
        DEPTH_LIMIT_M,
    )
    return _covariance(found.numpy(), np.eye(3), T[:3, 3])


def _covariance(
    information: Float[np.ndarray, "6 6"],
    turn: Float[np.ndarray, "3 3"],
    arm: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "6 6"] | None:
    """Covariance of (position, rotation vector), axes of the target, by an information with the rotation first.

    Args:
        information: About (rotation vector, position) in the axes of the library.
        turn: From these axes to those of the target.
        arm: From the point that the library moves to the source's origin, axes of the target.
    """
    swapped = information[np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])]
    if not np.isfinite(swapped).all() or np.linalg.eigvalsh(swapped)[0] <= 0.0:
        return None
    x, y, z = arm
    lever = np.eye(6)
    lever[:3, 3:] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    lever = lever @ np.kron(np.eye(2), turn)
    return np.asarray(lever @ np.linalg.inv(swapped) @ lever.T)


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
    found = small_gicp_motion(target.levels[0], source.levels[0], starts[0])
    return None if found is None else evaluate(target, source, found[0])


def small_gicp_motion(
    target: Level, source: Level, start: Pose3
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "6 6"] | None] | None:
    """T_target_source by small_gicp, and its covariance by the inverse of its Hessian, as `Alignment.covariance`.

    None with too few points.
    """
    import small_gicp  # type: ignore[import-not-found, unused-ignore]

    library: Any = small_gicp
    clouds = [cloud(level) for level in (target, source)]
    if min(len(one) for one in clouds) < 100:
        return None
    found = library.align(
        *clouds,
        init_T_target_source=start.matrix,
        registration_type="GICP",
        downsampling_resolution=GICP_VOXEL_M,
        max_correspondence_distance=GICP_REACH_M,
        num_threads=1,
    )
    T = np.array(found.T_target_source)
    return T, _covariance(np.array(found.H), T[:3, :3], np.zeros(3))


def cloud(level: Level) -> Float[np.ndarray, "n 3"]:
    """Points of a level, camera frame, m."""
    x, y = level.slopes
    keep = np.isfinite(level.z)
    z = level.z.astype(np.float64)
    points = np.stack([x[None, :] * z, y[:, None] * z, z], axis=-1)
    return np.ascontiguousarray(points[keep])
