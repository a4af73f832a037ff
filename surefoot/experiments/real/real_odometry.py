"""Trajectories of real recordings without a pose given, beside Open3D's and small_gicp's.

Ours runs as it does for any user: floor, odometry, places, one graph. The peers lay each image over the one
before, at full size, as their own examples do. Truth is for evaluation only; alignment by rotation and
translation, as the TUM tools do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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

from ...evaluation.metrics.consistency import nees
from ...evaluation.metrics.gauge_alignment import errors_in_space
from ...evaluation.metrics.trajectory import align, distances, rms
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
PEERS = ("open3d", "open3d-intensity", "open3d-depth", "small_gicp")
REPLICA_EVERY = 1  # all 2000; peers see fewer, or the run would take an hour
PEERS_EVERY = 10
SLIP_M = 0.10  # a step that is so wrong is a slip


@dataclass
class Way:
    """Poses of one contestant beside the truth."""

    found: list[Pose3]
    true: list[Pose3]
    lost: int = 0
    told: frozenset[int] = frozenset()
    claimed: Float[np.ndarray, "n 6 6"] | None = None

    @property
    def variance_ratio(self) -> float:
        """Mean square of what is left after alignment over what was claimed of it: 1 if honest; NaN without claims."""
        if self.claimed is None:
            return float("nan")
        placed = np.isfinite(self.claimed).all(axis=(1, 2))
        ways = [_trajectory(way, placed) for way in (self.found, self.true)]
        return float(nees(errors_in_space(*ways), self.claimed[placed]).mean()) / 6.0

    @property
    def ate_m(self) -> float:
        """Root mean square after the best rotation and translation; NaN if there is no unique one."""
        estimate = np.array([pose.position for pose in self.found])
        truth = np.array([pose.position for pose in self.true])
        best = align(estimate, truth)
        return float("nan") if best is None else rms(distances(best.apply(estimate), truth))

    @property
    def step_errors_m(self) -> list[float]:
        """From frame to frame."""
        return [
            float(np.linalg.norm(((a.inverse() @ b).inverse() @ (p.inverse() @ q)).position))
            for (a, b), (p, q) in zip(pairwise(self.true), pairwise(self.found), strict=True)
        ]

    @property
    def silent_slips(self) -> int:
        """Steps that are wrong and were not told to be."""
        return sum(
            error > SLIP_M and number + 1 not in self.told
            for number, error in enumerate(self.step_errors_m)
        )


def blind(frames: Iterable[Frame]) -> Iterator[tuple[Frame, Pose3]]:
    """Frames without their poses, and the poses apart."""
    for frame in frames:
        assert frame.T_world_camera is not None
        yield replace(frame, T_world_camera=None), frame.T_world_camera


def ours(frames: Iterable[Frame], seed: int = 0, method: str = "hybrid") -> tuple[Way, Way]:
    """The way step by step, and the way with loops closed."""
    config = OdometerConfig(align=AlignConfig(method=method))
    odometer = Odometer(np.random.default_rng(seed), config)
    steps, true = [], []
    for frame, pose in blind(frames):
        steps.append(odometer.track(frame))
        true.append(pose)
    bad = (LOST, RESTARTED, DOUBTFUL)
    told = frozenset(n for n, step in enumerate(steps) if step.state in bad)
    lost = odometer.odometry.losses
    joined, solution = odometer.trajectory()
    claims = odometer.uncertainty(solution)
    walked = Way([step.T_start_camera for step in steps], true, lost, told)
    return walked, Way(joined, true, lost, told, None if claims is None else claims.aligned)


def _trajectory(way: list[Pose3], placed: Bool[np.ndarray, "n"]) -> Trajectory:
    poses = [pose for pose, one in zip(way, placed, strict=True) if one]
    return Trajectory(
        np.flatnonzero(placed).astype(np.float64),
        np.array([pose.position for pose in poses]),
        np.array([pose.quat_xyzw for pose in poses]),
    )


def peer(name: str, frames: Iterable[Frame]) -> Way | None:
    """Each image over the one before; None where the peer is not installed."""
    try:
        lay = aligner(name)
        config = AlignConfig()
        before: Pyramid | None = None
        here, way = Pose3(), Way([], [])
        for frame, pose in blind(frames):
            depth, rgb = understood(frame)
            image = build(depth, rgb, None, PyramidConfig(finest_px=depth.camera.width, levels=1))
            if before is not None:
                aligned = lay(before, image, [Pose3()], config)
                if aligned is None:
                    way.lost += 1
                else:
                    here = here @ aligned.motion
            before = image
            way.found.append(here)
            way.true.append(pose)
    except ImportError:
        return None
    return way


def understood(frame: Frame) -> tuple[Depth, UInt8[np.ndarray, "h w 3"] | None]:
    """Depth with its deviation, and the picture."""
    assert frame.depth is not None
    return structured_light.depth(frame.depth), None if frame.colour is None else frame.colour.rgb


def recorded(name: str, say: Say) -> tuple[dict[str, float], list[str]]:
    """One recording: ours, ours by depth alone, and the peers."""
    recording = open_recording(real_data.folder(SETS[name]))
    figures: dict[str, float] = {}
    say(f"{name}: ours")
    walked, joined = ours(recording.frames())
    _, by_depth = ours(recording.frames(), method="depth")
    figures[f"{name}_ate_m"] = joined.ate_m
    figures[f"{name}_odometry_ate_m"] = walked.ate_m
    if joined.claimed is not None:
        figures[f"{name}_variance_ratio"] = joined.variance_ratio
    figures[f"{name}_depth_only_ate_m"] = by_depth.ate_m
    figures[f"{name}_step_max_m"] = max(joined.step_errors_m)
    figures[f"{name}_silent_slips"] = float(walked.silent_slips)
    figures[f"{name}_lost"] = float(walked.lost)
    rows = [row(name, "ours", joined), row(name, "ours, no loops", walked)]
    rows.append(row(name, "ours, depth only", by_depth))
    for other in PEERS:
        say(f"{name}: {other}")
        way = peer(other, recording.frames())
        if way is not None:
            key = other.replace("-", "_")
            figures[f"{name}_{key}_ate_m"] = way.ate_m
            figures[f"{name}_{key}_step_max_m"] = max(way.step_errors_m)
            rows.append(row(name, other, way))
    return figures, rows


def row(name: str, who: str, way: Way) -> str:
    """One line for people."""
    return (
        f"{name:<18} {who:<17} ATE {way.ate_m:8.4f} m   worst step {max(way.step_errors_m):7.4f} m"
        f"   lost {way.lost:3d}   silent slips {way.silent_slips}"
    )


def replica(seeds: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Replica's office, depth ray cast along its way; colour from the mesh's vertices for the loops."""
    room = ReplicaRoom(real_data.folder("replica_office0"))
    ates, odometry, worst, rows = [], [], [], []
    slips = lost = 0
    for seed in range(seeds):
        say(f"replica: ours, seed {seed}")
        frames = room.frames(np.random.default_rng(seed), REPLICA_EVERY)
        walked, joined = ours(frames, seed)
        ates.append(joined.ate_m)
        odometry.append(walked.ate_m)
        worst.append(max(joined.step_errors_m))
        slips += walked.silent_slips
        lost += walked.lost
        rows += [row("replica", "ours", joined), row("replica", "ours, no loops", walked)]
    figures = {
        "replica_ate_m": max(ates),
        "replica_odometry_ate_m": max(odometry),
        "replica_rpe_max_m": max(worst),
        "replica_silent_slips": float(slips),
        "replica_lost": float(lost),
    }
    for other in PEERS:
        say(f"replica: {other}")
        way = peer(other, room.frames(np.random.default_rng(0), PEERS_EVERY))
        if way is not None:
            figures[f"replica_{other.replace('-', '_')}_ate_m"] = way.ate_m
            rows.append(row(f"replica 1/{PEERS_EVERY}", other, way))
    return figures, rows


def run(seeds: int, say: Say) -> Outcome:
    """The recordings once, Replica with the noise of every seed."""
    figures: dict[str, float] = {}
    table: list[str] = []
    for name in SETS:
        try:
            measured, rows = recorded(name, say)
        except InputError as error:
            table.append(f"{name:<18} {error}")
            continue
        figures.update(measured)
        table += rows
    measured, rows = replica(seeds, say)
    figures.update(measured)
    slips = [value for name, value in figures.items() if name.endswith("_silent_slips")]
    return Outcome({**figures, "silent_slips": float(sum(slips))}, table + rows)


EXPERIMENT = Experiment(
    id="real-odometry",
    title="Trajectories of recordings without poses, beside Open3D's and small_gicp's",
    run=run,
    targets={
        "sevenscenes_sweep_ate_m": Target("<=", 0.030),
        "sevenscenes_pan_ate_m": Target("<=", 0.013),
        "tum_fr3_cabinet_ate_m": Target("<=", 0.03),
        "redwood_ate_m": Target("<=", 0.005),
        "replica_ate_m": Target("<=", 0.008),
        "replica_rpe_max_m": Target("<=", 0.02),
        "silent_slips": Target("==", 0.0),
        "sevenscenes_sweep_variance_ratio": Target("<=", 4.0),  # 4: twice as far off as claimed
        "sevenscenes_pan_variance_ratio": Target("<=", 4.0),
        "tum_fr3_cabinet_variance_ratio": Target("<=", 4.0),
    },
    seeds=1,
)
