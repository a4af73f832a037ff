"""RGB-D odometry of real recordings without given poses, compared with Open3D and small_gicp.

Ours runs as for any user: floor, odometry, loop closures, one pose graph. The baselines align each image with the one
before at full resolution, as in their own examples. Truth is used for evaluation only, after rigid alignment as by the
TUM tools.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, UInt8

from perception.depth import structured_light
from perception.odometry.alignment import AlignConfig
from perception.odometry.baselines import aligner
from perception.odometry.odometry import DOUBTFUL, LOST, RESTARTED
from perception.odometry.pyramid import Pyramid, PyramidConfig, build
from perception.odometry.rgbd_odometry import Odometer, OdometerConfig
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth, Frame
from perception.primitives.pose import Pose3

from ...evaluation.metrics.averages import rms
from ...evaluation.metrics.consistency import squared, whitened
from ...evaluation.metrics.gauge_alignment import errors_in_space
from ...evaluation.metrics.trajectory import align, distances
from ...recordings.open import open_recording
from ...results.tables import Trajectory
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Say, Target
from .replica_room import ReplicaRoom

SETS = {
    "sevenscenes_sweep": "sevenscenes_redkitchen/sweep",
    "sevenscenes_pan": "sevenscenes_redkitchen/pan",
    "tum_fr3_cabinet": "tum_fr3_cabinet",
    "redwood": "redwood_livingroom",
}
BASELINES = ("open3d", "open3d-intensity", "open3d-depth", "small_gicp")
REPLICA_EVERY = 1  # all 2000 frames
BASELINES_EVERY = 10  # fewer frames, or the run would take an hour
SLIP_M = 0.10  # a larger error from frame to frame is a slip


@dataclass
class TrajectoryResult:
    """Estimated and true poses of one method.

    Args:
        found, true: Poses of every frame.
        lost: Number of losses.
        flagged: Frames that the method reports as doubtful.
        claimed: Covariances after alignment.
    """

    found: list[Pose3]
    true: list[Pose3]
    lost: int = 0
    flagged: frozenset[int] = frozenset()
    claimed: Float[np.ndarray, "n 6 6"] | None = None

    @property
    def variance_ratio(self) -> float:
        """Mean NEES per degree of freedom after alignment: 1 if consistent; NaN without covariances."""
        if self.claimed is None:
            return float("nan")
        placed = np.isfinite(self.claimed).all(axis=(1, 2))
        pair = [trajectory(poses, placed) for poses in (self.found, self.true)]
        return float(squared(whitened(errors_in_space(*pair), self.claimed[placed])).mean()) / 6.0

    @property
    def ate_m(self) -> float:
        """Absolute trajectory error (rms) after rigid alignment; NaN if the alignment is not unique."""
        return ate_m(self.found, self.true)

    @property
    def step_errors_m(self) -> list[float]:
        """Translation errors from frame to frame."""
        return [
            float(np.linalg.norm(((a.inverse() @ b).inverse() @ (p.inverse() @ q)).position))
            for (a, b), (p, q) in zip(pairwise(self.true), pairwise(self.found), strict=True)
        ]

    @property
    def silent_slips(self) -> int:
        """Number of slips in frames that are not flagged."""
        return sum(
            error > SLIP_M and number + 1 not in self.flagged
            for number, error in enumerate(self.step_errors_m)
        )


def ate_m(found: Sequence[Pose3], true: Sequence[Pose3]) -> float:
    """RMS position error after rigid alignment, m; NaN if the alignment is not unique."""
    mine, theirs = (np.array([pose.position for pose in poses]) for poses in (found, true))
    best = align(mine, theirs)
    return float("nan") if best is None else rms(distances(best.apply(mine), theirs))


def without_poses(frames: Iterable[Frame]) -> Iterator[tuple[Frame, Pose3]]:
    """Frames without their poses, and the poses separately."""
    for frame in frames:
        assert frame.T_world_camera is not None
        yield replace(frame, T_world_camera=None), frame.T_world_camera


def our_odometry(
    frames: Iterable[Frame], seed: int = 0, method: str = "hybrid"
) -> tuple[TrajectoryResult, TrajectoryResult]:
    """Trajectories of our method: odometry alone, and with loop closures."""
    config = OdometerConfig(align=AlignConfig(method=method))
    odometer = Odometer(np.random.default_rng(seed), config)
    steps, true = [], []
    for frame, pose in without_poses(frames):
        steps.append(odometer.track(frame))
        true.append(pose)
    bad = (LOST, RESTARTED, DOUBTFUL)
    flagged = frozenset(n for n, step in enumerate(steps) if step.state in bad)
    lost = odometer.odometry.losses
    closed, solution = odometer.trajectory()
    claims = odometer.uncertainty(solution)
    odometry_only = TrajectoryResult([step.T_start_camera for step in steps], true, lost, flagged)
    return odometry_only, TrajectoryResult(
        closed, true, lost, flagged, None if claims is None else claims.aligned
    )


def trajectory(poses: list[Pose3], placed: Bool[np.ndarray, "n"]) -> Trajectory:
    """The poses that are placed, with their numbers as stamps."""
    kept = [pose for pose, one in zip(poses, placed, strict=True) if one]
    return Trajectory(
        np.flatnonzero(placed).astype(np.float64),
        np.array([pose.position for pose in kept]),
        np.array([pose.quat_xyzw for pose in kept]),
    )


def baseline_odometry(name: str, frames: Iterable[Frame]) -> TrajectoryResult | None:
    """Trajectory of a baseline by frame-to-frame alignment; None if it is not installed."""
    try:
        align_images = aligner(name)
        config = AlignConfig()
        before: Pyramid | None = None
        here, result = Pose3(), TrajectoryResult([], [])
        for frame, pose in without_poses(frames):
            depth, rgb = depth_and_colour(frame)
            image = build(depth, rgb, None, PyramidConfig(finest_px=depth.camera.width, levels=1))
            if before is not None:
                aligned = align_images(before, image, [Pose3()], config)
                if aligned is None:
                    result.lost += 1
                else:
                    here = here @ aligned.motion
            before = image
            result.found.append(here)
            result.true.append(pose)
    except ImportError:
        return None
    return result


def depth_and_colour(frame: Frame) -> tuple[Depth, UInt8[np.ndarray, "h w 3"] | None]:
    """Depth with its standard deviation, and the colour image."""
    assert frame.depth is not None
    return structured_light.depth(frame.depth), None if frame.colour is None else frame.colour.rgb


def on_recording(name: str, say: Say) -> tuple[dict[str, float], list[str]]:
    """One recording: our method, our method by depth alone, and the baselines."""
    recording = open_recording(real_data.folder(SETS[name]))
    figures: dict[str, float] = {}
    say(f"{name}: ours")
    odometry_only, closed = our_odometry(recording.frames())
    _, by_depth = our_odometry(recording.frames(), method="depth")
    figures[f"{name}_ate_m"] = closed.ate_m
    figures[f"{name}_odometry_ate_m"] = odometry_only.ate_m
    if closed.claimed is not None:
        figures[f"{name}_variance_ratio"] = closed.variance_ratio
    figures[f"{name}_depth_only_ate_m"] = by_depth.ate_m
    figures[f"{name}_step_max_m"] = max(closed.step_errors_m)
    figures[f"{name}_silent_slips"] = float(odometry_only.silent_slips)
    figures[f"{name}_lost"] = float(odometry_only.lost)
    rows = [row(name, "ours", closed), row(name, "ours, no loops", odometry_only)]
    rows.append(row(name, "ours, depth only", by_depth))
    for other in BASELINES:
        say(f"{name}: {other}")
        result = baseline_odometry(other, recording.frames())
        if result is not None:
            key = other.replace("-", "_")
            figures[f"{name}_{key}_ate_m"] = result.ate_m
            figures[f"{name}_{key}_step_max_m"] = max(result.step_errors_m)
            rows.append(row(name, other, result))
    return figures, rows


def row(name: str, method: str, result: TrajectoryResult) -> str:
    """One row of the table."""
    return (
        f"{name:<18} {method:<17} ATE {result.ate_m:8.4f} m   worst step {max(result.step_errors_m):7.4f} m"
        f"   lost {result.lost:3d}   silent slips {result.silent_slips}"
    )


def replica(seeds: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Replica's office: depth ray cast along its trajectory, and colour from the mesh's vertices."""
    room = ReplicaRoom(real_data.folder("replica_office0"))
    ates, odometry, worst, rows = [], [], [], []
    slips = lost = 0
    for seed in range(seeds):
        say(f"replica: ours, seed {seed}")
        frames = room.frames(np.random.default_rng(seed), REPLICA_EVERY)
        odometry_only, closed = our_odometry(frames, seed)
        ates.append(closed.ate_m)
        odometry.append(odometry_only.ate_m)
        worst.append(max(closed.step_errors_m))
        slips += odometry_only.silent_slips
        lost += odometry_only.lost
        rows += [row("replica", "ours", closed), row("replica", "ours, no loops", odometry_only)]
    figures = {
        "replica_ate_m": max(ates),
        "replica_odometry_ate_m": max(odometry),
        "replica_rpe_max_m": max(worst),
        "replica_silent_slips": float(slips),
        "replica_lost": float(lost),
    }
    for other in BASELINES:
        say(f"replica: {other}")
        result = baseline_odometry(other, room.frames(np.random.default_rng(0), BASELINES_EVERY))
        if result is not None:
            figures[f"replica_{other.replace('-', '_')}_ate_m"] = result.ate_m
            rows.append(row(f"replica 1/{BASELINES_EVERY}", other, result))
    return figures, rows


def run(seeds: int, say: Say, sets: int = len(SETS) + 1) -> Outcome:
    """The recordings once, Replica with the noise of every seed; `sets`: only the first of them."""
    figures: dict[str, float] = {}
    table: list[str] = []
    for name in list(SETS)[:sets]:
        try:
            measured, rows = on_recording(name, say)
        except InputError as error:
            table.append(f"{name:<18} {error}")
            continue
        figures.update(measured)
        table += rows
    if sets > len(SETS):
        measured, rows = replica(seeds, say)
        figures.update(measured)
        table += rows
    slips = [value for name, value in figures.items() if name.endswith("_silent_slips")]
    return Outcome({**figures, "silent_slips": float(sum(slips))}, table)


EXPERIMENT = Experiment(
    id="real-odometry",
    title="RGB-D odometry of real recordings without poses, compared with Open3D and small_gicp",
    run=run,
    targets={
        "sevenscenes_sweep_ate_m": Target("<=", 0.030),
        "sevenscenes_pan_ate_m": Target("<=", 0.013),
        "tum_fr3_cabinet_ate_m": Target("<=", 0.03),
        "redwood_ate_m": Target("<=", 0.005),
        "replica_ate_m": Target("<=", 0.008),
        "replica_rpe_max_m": Target("<=", 0.02),
        "silent_slips": Target("==", 0.0),
        "sevenscenes_sweep_variance_ratio": Target(
            "<=", 4.0
        ),  # 4: errors of twice the claimed standard deviation
        "sevenscenes_pan_variance_ratio": Target("<=", 4.0),
        "tum_fr3_cabinet_variance_ratio": Target("<=", 4.0),
    },
    seeds=1,
)
