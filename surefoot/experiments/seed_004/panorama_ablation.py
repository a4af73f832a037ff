"""What features and surfaces each contribute to a panorama: rotation errors without either, and with those of others.

Textured, plain and repetitive rooms (`panorama_rooms`), encoder errors of 0.6, 2 and 5 deg, which the panorama is told.
Settings were chosen on seeds 100 to 102; seeds from 0 on are reported.

Source: ours; SIFT for MDGHM-SIFT as in Kang 2013 (seed 004); Open3D: Zhou et al. 2018.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mapping.panorama.stitching import StitchConfig, place
from mapping.panorama.surfaces import (
    CORRELATED,
    GATES_M,
    LEAST_SHARE,
    LEAST_SIGMA_M,
    ROUNDS,
    Alignment,
    Surface,
)
from mapping.panorama.views import PriorConfig
from perception.primitives.pose import Pose3

from ..support.experiment import Say
from ..support.trials import run_all
from . import panorama_rooms
from .panorama_scenes import errors_deg, nine_views

OFFSETS_DEG = (0.6, 2.0, 5.0)
GAIN_DEG = 2.0  # of `features_gain_textured`


def variants() -> dict[str, StitchConfig]:
    """Name to the stitching settings that are compared."""
    full = StitchConfig()
    sift = replace(full.pairs, sift=replace(full.pairs.sift, method="difference"))
    return {
        "full": full,
        "no_features": replace(full, features=False),
        "no_icp": replace(full, surfaces=False),
        "encoders": replace(full, features=False, surfaces=False),
        "sift": replace(full, pairs=sift),
        "open3d_icp": replace(full, aligner=open3d_align),
    }


def open3d_align(
    target: Surface, source: Surface, start: Pose3, position_sigma_m: float = math.inf
) -> Alignment | None:
    """Open3D's point to plane with our points, normals and gates; it cannot hold the position."""
    import open3d

    clouds = []
    for one in (source, target):
        known = np.isfinite(one.normals).all(axis=-1) & np.isfinite(one.points).all(axis=-1)
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(one.points[known]))
        cloud.normals = open3d.utility.Vector3dVector(one.normals[known])
        clouds.append(cloud)
    if min(len(cloud.points) for cloud in clouds) < 6:
        return None
    registration = open3d.pipelines.registration
    method = registration.TransformationEstimationPointToPlane(registration.HuberLoss(0.01))
    often = registration.ICPConvergenceCriteria(max_iteration=ROUNDS)
    motion, pairs = start.matrix, np.zeros((0, 2), int)
    for gate in GATES_M:
        found = registration.registration_icp(*clouds, gate, motion, method, often)
        motion, pairs = found.transformation, np.asarray(found.correspondence_set)
        if found.fitness < LEAST_SHARE:
            return None
    points = np.asarray(clouds[0].points)[pairs[:, 0]]
    normal = np.asarray(clouds[1].normals)[pairs[:, 1]]
    gap = points @ motion[:3, :3].T + motion[:3, 3] - np.asarray(clouds[1].points)[pairs[:, 1]]
    square = float(np.mean((gap * normal).sum(axis=1) ** 2))
    across = normal @ motion[:3, :3]
    jacobian = np.concatenate([np.cross(points, across), across], axis=1)
    hessian = jacobian.T @ jacobian
    if np.linalg.cond(hessian) > 1e9:
        return None
    covariance = CORRELATED * max(square, LEAST_SIGMA_M**2) * np.linalg.inv(hessian)
    pose = Pose3.from_rotation(motion[:3, :3], motion[:3, 3])
    return Alignment(pose, covariance)


def squares(kind: str, room: str, offset_deg: float, seed: int) -> dict[str, float]:
    """Mean square of the rotation errors of nine views by each setting, deg^2."""
    rng = np.random.default_rng([seed, 50])
    views, true = nine_views(panorama_rooms.load(kind, room, seed), rng, offset_deg)
    prior = PriorConfig(pan_deg=offset_deg, tilt_deg=offset_deg)
    found = {}
    for name, config in variants().items():
        rng = np.random.default_rng([seed, 51])
        placed, _, _ = place(views, rng, replace(config, prior=prior))
        poses = [one.T_base_camera for one in placed if one is not None]
        found[name] = float(np.mean(errors_deg(poses, true, True) ** 2))
    return found


def ablation(seeds: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Figures and table: nine rooms with three offsets per seed, about ten seconds each."""
    kinds = [(kind, room) for kind, rooms in panorama_rooms.KINDS.items() for room in rooms]
    todo = [(*one, deg, seed) for deg in OFFSETS_DEG for one in kinds for seed in range(seeds)]
    results = run_all(squares, todo, say, "rooms")
    names = list(variants())
    table = ["deg, rms      offset  " + "".join(f"{name:>13}" for name in names)]
    figures: dict[str, float] = {}
    gains: dict[tuple[str, float], float] = {}
    for deg in OFFSETS_DEG:
        for kind in panorama_rooms.KINDS:
            chosen = [
                one for one, task in zip(results, todo, strict=True) if task[::2] == (kind, deg)
            ]
            rms = {name: math.sqrt(np.mean([one[name] for one in chosen])) for name in names}
            cells = "".join(f"{rms[name]:13.3f}" for name in names)
            table.append(f"{kind:<12}  {deg:6.1f}  {cells}")
            figures |= {f"{kind}_{deg:g}deg_{name}": value for name, value in rms.items()}
            gains[kind, deg] = rms["full"] / rms["no_features"]
    figures["features_gain_textured"] = gains.pop(("textured", GAIN_DEG))
    figures["features_gain_elsewhere"] = max(gains.values())
    return figures, table
