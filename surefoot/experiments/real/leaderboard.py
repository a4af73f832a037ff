"""RGB-D odometry of Surefoot, Open3D, small_gicp and KISS-ICP on the same frames: accuracy and honesty.

Each method runs as its users run it: ours live, without loop closures; Open3D (hybrid) and small_gicp (GICP) from
frame to frame; KISS-ICP against its local map. Covariances are what the method offers: our own; the inverse of the
information matrix that Open3D gives pose graphs; the inverse of small_gicp's Hessian; none of KISS-ICP. Steps are
compounded as independent. Truth judges only.

Source: ours; Vizzo et al. 2023 (KISS-ICP); Koide 2024 (small_gicp).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.odometry import baselines
from perception.odometry.odometry import LOST, RESTARTED
from perception.odometry.odometry_poses import OdometryPoses
from perception.odometry.pose_uncertainty import compounded, error_transport
from perception.odometry.pyramid import Level, PyramidConfig, build
from perception.odometry.rgbd_odometry import OdometerConfig
from perception.odometry.view_errors import (
    since_start,
    view_correlation,
    view_error_covariances,
)
from perception.primitives.frame import Frame
from perception.primitives.pose import Pose3

from ...config.schema import Config
from ...evaluation.metrics import calibration as scores
from ...evaluation.metrics.averages import rms
from ...evaluation.metrics.consistency import squared, whitened
from ...evaluation.metrics.gauge_alignment import errors_in_space
from ...results.camera_trajectory import aligned_covariances
from .odometry import ate_m, depth_and_colour, trajectory, without_poses

KISS_RANGE_M = (0.3, 6.0)  # of the depth cameras
KISS_VOXEL_M = 0.06  # KISS-ICP's own rule: a hundredth of the range
WITHOUT = "no covariance"


@dataclass
class Track:
    """A trajectory with the covariances that a user of the method takes.

    Args:
        found, true: T_start_camera and T_world_camera of each frame.
        shared: Covariance of the error that later poses inherit, axes of the start; NaN where the pose is unknown.
        reference: Frame that each frame was aligned with.
        lost: Frames without a pose.
        of_view: Covariance of the error that depends on the view, see `perception.odometry.view_errors`.
    """

    found: list[Pose3] = field(default_factory=list)
    true: list[Pose3] = field(default_factory=list)
    shared: list[Float[np.ndarray, "6 6"]] = field(default_factory=list)
    reference: list[int] = field(default_factory=list)
    lost: int = 0
    of_view: Float[np.ndarray, "6 6"] = field(default_factory=lambda: np.zeros((6, 6)))

    def add(self, found: Pose3, true: Pose3, shared: np.ndarray, to: int) -> None:
        """Add a frame."""
        self.found.append(found)
        self.true.append(true)
        self.shared.append(shared)
        self.reference.append(to)

    @property
    def ate_m(self) -> float:
        """RMS position error after rigid alignment; NaN if it is not determined."""
        return ate_m(self.found, self.true)

    @property
    def claims(self) -> bool:
        """Whether the method has covariances."""
        return bool(np.isfinite(self.shared).all(axis=(1, 2)).any())

    def variance_ratio(self) -> float:
        """Mean NEES per degree of freedom of the whole trajectory after rigid alignment."""
        shared = np.array(self.shared)
        placed = np.isfinite(shared).all(axis=(1, 2))
        mine, theirs = (trajectory(poses, placed) for poses in (self.found, self.true))
        rotations = Rotation.from_quat(mine.quats_xyzw).as_matrix()
        left = aligned_covariances(mine.positions, shared[placed])
        left = left + view_error_covariances(mine.positions, rotations, self.of_view).aligned
        return float(np.mean(squared(whitened(errors_in_space(mine, theirs), left)))) / 6.0

    def steps(self) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"]]:
        """Errors of the motions from frame to frame, start axes, and their claimed covariances (NaN without)."""
        errors, claims = [], []
        for j in range(1, len(self.found)):
            mine = self.found[j - 1].inverse() @ self.found[j]
            true = self.true[j - 1].inverse() @ self.true[j]
            turned = Rotation.from_matrix(mine.rotation @ true.rotation.T).as_rotvec()
            axes = self.found[j - 1].rotation
            errors.append(np.concatenate([axes @ (mine.position - true.position), axes @ turned]))
            claims.append(self._claim(j))
        return np.array(errors), np.array(claims)

    def _claim(self, j: int) -> Float[np.ndarray, "6 6"]:
        """Covariance of the motion from frame j - 1 to j: what was added since the reference that both share."""
        i = j - 1
        base = i if self.reference[j] == i else min(self.reference[i], self.reference[j])

        def moved(of: int, covariance: np.ndarray) -> np.ndarray:
            lever = error_transport(self.found[j].position - self.found[of].position)
            return np.asarray(lever @ covariance @ lever.T)

        a, b = self.found[i], self.found[j]
        alike = view_correlation(
            b.position[None], b.rotation[None], a.position[None], a.rotation[None]
        )
        whole = self.shared[j] - moved(base, self.shared[base])
        whole = whole + since_start(self.of_view, b.position - a.position, float(alike[0, 0]))
        if base != i:
            lever = error_transport(self.found[i].position - self.found[base].position)
            whole = whole + moved(i, self.shared[i] - lever @ self.shared[base] @ lever.T)
        return (whole + whole.T) / 2.0


def ours(frames: Iterable[Frame], calibrated: bool = False) -> Track:
    """Our live odometry; `calibrated` as `RecordingInfo` has it."""
    floor = Config().floor_of(calibrated)
    source = OdometryPoses(np.random.default_rng(0), OdometerConfig(loops=False), floor)
    track, unknown = Track(), np.full((6, 6), np.nan)
    for frame, true in without_poses(frames):
        source.update(frame, ())
        step = source.step
        assert step is not None
        camera = source.camera
        shared = unknown if camera is None else camera.shared
        track.of_view = track.of_view if camera is None else camera.of_view
        track.lost += step.state in (LOST, RESTARTED)
        track.add(step.T_start_camera, true, shared, step.reference)
    return track


Matcher = Callable[[Level, Level], tuple[np.ndarray, np.ndarray | None] | None]


def by_steps(frames: Iterable[Frame], match: Matcher) -> Track:
    """Frame-to-frame alignment at full resolution; a step that fails is one without motion."""
    track, before = Track(), None
    here, shared = Pose3(), np.zeros((6, 6))
    for number, (frame, true) in enumerate(without_poses(frames)):
        image = _image(frame)
        if before is not None:
            found = match(before, image)
            track.lost += found is None
            if found is not None:
                motion = Pose3.from_matrix(found[0])
                step = np.full((6, 6), np.nan) if found[1] is None else found[1]
                shared = compounded(shared, here, motion, step)
                here = here @ motion
        before = image
        track.add(here, true, shared, max(number - 1, 0))
    return track


def open3d(frames: Iterable[Frame]) -> Track:
    """Open3D's hybrid odometry with its information matrix."""

    def match(target: Level, source: Level) -> tuple[np.ndarray, np.ndarray | None] | None:
        T = baselines.open3d_motion(target, source, Pose3())
        return None if T is None else (T, baselines.open3d_covariance(target, source, T))

    return by_steps(frames, match)


def small_gicp(frames: Iterable[Frame]) -> Track:
    """small_gicp's GICP with the inverse of its Hessian."""
    return by_steps(frames, lambda a, b: baselines.small_gicp_motion(a, b, Pose3()))


def kiss_icp(frames: Iterable[Frame]) -> Track:
    """KISS-ICP, made for lidars, on the clouds of the depth images; it has no covariance."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config: Any = KISSConfig()
    config.data.min_range, config.data.max_range = KISS_RANGE_M
    config.data.deskew = False
    config.mapping.voxel_size = KISS_VOXEL_M
    config.registration.max_num_threads = 1
    odometry: Any = KissICP(config)
    track, unknown = Track(), np.full((6, 6), np.nan)
    for number, (frame, true) in enumerate(without_poses(frames)):
        points = baselines.cloud(_image(frame))
        odometry.register_frame(points, np.zeros(0))
        found = Pose3.from_matrix(np.array(odometry.last_pose))
        track.add(found, true, unknown, max(number - 1, 0))
    return track


METHODS: dict[str, Callable[[Iterable[Frame]], Track]] = {
    "ours": ours,
    "open3d": open3d,
    "small_gicp": small_gicp,
    "kiss_icp": kiss_icp,
}


def tracked(name: str, frames: Iterable[Frame], calibrated: bool = False) -> Track | None:
    """The trajectory of a method; None if it is not installed. Only ours knows whether the camera is calibrated."""
    try:
        return ours(frames, calibrated) if name == "ours" else METHODS[name](frames)
    except ImportError:
        return None


def _image(frame: Frame) -> Level:
    depth, rgb = depth_and_colour(frame)
    return build(depth, rgb, None, PyramidConfig(finest_px=depth.camera.width, levels=1)).levels[0]


def row(recording: str, method: str, track: Track | None) -> tuple[dict[str, float], str]:
    """Figures and the table's line of a method on a recording."""
    if track is None:
        return {}, f"{recording:<16} {method:<11} not installed (extra bench): not compared"
    errors, claims = track.steps()
    key = f"{recording}_{method}"
    worst = float(np.max(np.linalg.norm(errors[:, :3], axis=1)))
    figures = {
        f"{key}_ate_m": track.ate_m,
        f"{key}_rpe_mm": 1e3 * rms(np.linalg.norm(errors[:, :3], axis=1)),
    }
    line = (
        f"{recording:<16} {method:<11} ATE {track.ate_m:7.4f} m  RPE {figures[f'{key}_rpe_mm']:6.2f} mm  "
        f"worst step {worst:6.3f} m  lost {track.lost:3d}  "
    )
    known = np.isfinite(squared(whitened(errors, claims))) if track.claims else np.zeros(0, bool)
    if known.sum() < 4:
        return figures, line + WITHOUT
    ratio = float(np.mean(squared(whitened(errors[known], claims[known])))) / 6.0
    whole = track.variance_ratio()
    sigmas = np.sqrt(np.diagonal(claims[known], axis1=1, axis2=2))[:, :3]
    figures |= {
        f"{key}_step_sigma_factor": float(np.sqrt(ratio)),
        f"{key}_trajectory_sigma_factor": float(np.sqrt(whole)),
        f"{key}_step_crps_mm": 1e3 * float(scores.crps(errors[known, :3], sigmas).mean()),
    }
    return figures, line + (
        f"steps {_words(ratio)}  trajectory {_words(whole)}  CRPS {figures[f'{key}_step_crps_mm']:6.2f} mm"
    )


def _words(ratio: float) -> str:
    """Direction and factor of a variance ratio."""
    factor = float(np.sqrt(ratio))
    return (
        f"{'too sure' if factor > 1.0 else 'careful '} x{max(factor, 1.0 / max(factor, 1e-9)):6.2f}"
    )
