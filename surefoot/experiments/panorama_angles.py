"""Nine views, a panorama, its key angles and all others, in simulated rooms, against the truth.

A head turns to the nine key directions with encoders that are half a degree off, each view on its own. The
panorama must tell better where each view looked, and say how sure it is. Errors of rotation are taken after
the mean rotation between estimate and truth; beside it those in the base frame as they are.

Source: seed 004, Figs. 2 and 6, section 2.2.2.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from mapping.panorama.key_angles import laws
from mapping.panorama.stitching import Panorama, StitchConfig, place, stitch
from mapping.panorama.views import View, head_directions, view_of_depth
from perception import time_of_flight
from perception.features.pictures import amplitude_picture
from perception.primitives.frame import RangeView
from perception.primitives.pose import Pose3, head_rotation
from sim import scenes
from sim.rays import RayCaster
from sim.tof_camera import TofCamera, TofConfig

from .experiment import Experiment, Outcome, Say, Target

ENCODER_DEG = 0.5  # deviation of pan and of tilt, each view on its own
CAMERA_HEIGHT_M = 0.55  # seed 004
LEVER_M = np.array([0.0, -0.035, 0.035])  # DARwIn-OP: camera about the neck, camera axes
ROOMS = ("boxes", "home", "corridor")


def look_round(room: str, seed: int) -> tuple[list[View], list[Pose3]]:
    """Nine views from where the robot starts, and their true poses on the body."""
    scene = scenes.load(room, seed)
    caster = RayCaster(scene)
    caster.place([mover.start for mover in scene.movers])
    rng = np.random.default_rng([seed, 50])
    camera = TofCamera(TofConfig(), rng)
    views, true = [], []
    for number, (pan, tilt) in enumerate(head_directions()):
        off = math.radians(ENCODER_DEG) * rng.standard_normal(2)
        pose, prior = _head(pan + off[0], tilt + off[1]), _head(pan, tilt)
        range_m, amplitude = camera.measure(caster, scene.start.lifted() @ pose)
        depth = time_of_flight.depth(RangeView(range_m, amplitude, camera.camera, prior))
        views.append(view_of_depth(depth, 5.0, amplitude_picture(amplitude), prior, float(number)))
        true.append(pose)
    return views, true


def _head(pan_rad: float, tilt_rad: float) -> Pose3:
    rotation = head_rotation(float(pan_rad), float(tilt_rad))
    return Pose3.from_rotation(rotation, np.array([0.0, 0.0, CAMERA_HEIGHT_M]) + rotation @ LEVER_M)


def errors_deg(poses: list[Pose3], true: list[Pose3], aligned: bool) -> np.ndarray:
    """Angle of each rotation off the true one, after the mean rotation between both or as it is."""
    between = Rotation.from_matrix(
        np.array([p.rotation @ t.rotation.T for p, t in zip(poses, true, strict=True)])
    )
    return np.degrees((between.mean().inv() * between if aligned else between).magnitude())


def law_errors_deg(panorama: Panorama, views: list[View]) -> float:
    """Root mean square of the interpolated angles off those the panorama is drawn by."""
    assert panorama.drawing is not None, "every view has a prior, so every view is drawn"
    across, down = laws(panorama.drawing, views)
    sphere = panorama.drawing.sphere
    x, y = np.arange(sphere.width, dtype=float), np.arange(sphere.height, dtype=float)
    theta, phi = sphere.angles(x, np.zeros(1))[0], sphere.angles(np.zeros(1), y)[1]
    off = np.concatenate([across.angle(x) - theta, down.angle(y) - phi])
    return math.degrees(float(np.sqrt(np.mean(off**2))))


def run(seeds: int, say: Say) -> Outcome:
    """Three kinds of rooms a seed; about five seconds each."""
    found: dict[str, list[float]] = {}
    table = [
        "room      seed  encoders  features  panorama  worst view  pairs  NEES  key angles, deg"
    ]
    for seed in range(seeds):
        for room in ROOMS:
            views, true = look_round(room, seed)
            rng = np.random.default_rng([seed, 51])
            panorama = stitch(views, rng)
            by_features, _ = place(views, rng, replace(StitchConfig(), surfaces=False))
            poses = [p.T_base_camera for p in panorama.placed if p is not None]
            only = [p.T_base_camera for p in by_features if p is not None]
            priors = [view.prior for view in views if view.prior is not None]
            nees = []
            for placed, truth in zip(panorama.placed, true, strict=True):
                assert placed is not None, "every view has a prior"
                turn = Rotation.from_matrix(placed.T_base_camera.rotation.T @ truth.rotation)
                error = turn.as_rotvec()
                nees.append(float(error @ np.linalg.solve(placed.covariance[:3, :3], error)) / 3.0)
            row = {
                "encoders": float(np.mean(errors_deg(priors, true, True) ** 2)),
                "features": float(np.mean(errors_deg(only, true, True) ** 2)),
                "angle": float(np.mean(errors_deg(poses, true, True) ** 2)),
                "angle_base": float(np.mean(errors_deg(poses, true, False) ** 2)),
                "nees": float(np.mean(nees)),
                "law": law_errors_deg(panorama, views) ** 2,
            }
            for name, value in row.items():
                found.setdefault(name, []).append(value)
            worst = float(errors_deg(poses, true, True).max())
            table.append(
                f"{room:<9} {seed:4d}  {math.sqrt(row['encoders']):8.2f}"
                f"  {math.sqrt(row['features']):8.2f}  {math.sqrt(row['angle']):8.2f}"
                f"  {worst:10.2f}  {len(panorama.links):5d}  {row['nees']:4.1f}"
                f"  {math.sqrt(row['law']):.2f}"
            )
            say(table[-1])
    figures = {
        f"{name}_rms_deg": float(np.sqrt(np.mean(values)))
        for name, values in found.items()
        if name != "nees"
    }
    figures["nees_per_axis"] = float(np.mean(found["nees"]))
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="004-E5",
    title="Nine views, panorama, key and all angles: encoders half a degree off are put right",
    run=run,
    targets={
        "angle_rms_deg": Target("<=", 0.3),
        "angle_base_rms_deg": Target("<=", 0.5),
        "law_rms_deg": Target("<=", 0.5),
    },
    seeds=3,
)
