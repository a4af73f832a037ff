"""Errors of the simulated cameras: depth of each renderer, stereo by three matchers, time of flight.

Views are taken at the start and the goals of furnished homes, in random head directions. The depth of a renderer is
compared with ray casting where a pixel and its neighbours lie on one surface; given are the share of such pixels and
the share of them that is correct within a millimetre. The ranges that the time-of-flight camera takes from PyBullet are
compared with ray casting in the same way (`range_sources`). Stereo and time of flight have two figures per range band, next
to those of the measurement notes from which the models were built (in parentheses); `_off` is the relative difference.
A plot shows artefacts of the time-of-flight camera: ranges beyond c / 2f wrap, pixels on edges lie between both
surfaces (flying pixels), and rotation during the four exposures of one measurement distorts ranges.

Source: seed 003, E2 (ranges); Kang 2013 (seed 004), Table 3 (SR-4000).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float32

from perception.depth import stereo
from perception.primitives.camera import Camera
from perception.primitives.frame import StereoView
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.rendering.motion import Motion
from sim.rendering.rays import RayCaster
from sim.rendering.renderer import choose_renderer
from sim.robot_config import RobotConfig
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes import catalogue
from sim.sensors.cameras import stereo_pair
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.shapes import Box
from sim.world import World

from ...report.plots import style
from ..support.experiment import Experiment, Outcome, Say, Target, combined
from ..support.simulated_depth import on_one_surface, true_depth
from .range_sources import range_errors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EYE_M = 0.383  # height of the robot's camera while it walks
VIEWS_PER_HOME = 6  # views per home
TURNING_RADPS, INTEGRATION_S = 1.0, 0.03  # ours: a sweeping head, and an SR-4000 indoors
SHOTS = 8  # images for the standard deviation of time of flight
RENDERED_M = ((0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 5.5))
STEREO_M = {  # notes: p50 and p95 in mm of OpenCV's two matchers
    (0.2, 0.5): {"bm": (1, 3), "sgbm": (1, 3)},
    (0.5, 1.0): {"bm": (1, 5), "sgbm": (3, 9)},
    (1.0, 1.5): {"bm": (5, 19), "sgbm": (9, 26)},
    (2.0, 3.0): {"bm": (14, 106), "sgbm": (37, 117)},
    (3.0, 4.0): {"bm": (29, 231), "sgbm": (76, 250)},
}
FLOOR_SHARE = {"bm": 0.84, "sgbm": 0.98}  # notes: least share of the floor with a depth
EXACT_M = 0.001  # notes: tolerance of a renderer
OFF = 0.5  # ours: tolerated relative difference from the notes
TOF_M = {
    (0.3, 1.0): 4,
    (1.0, 1.5): 6,
    (1.5, 2.0): 11,
    (2.0, 3.0): 18,
}  # notes: temporal standard deviation, mm


@dataclass(frozen=True)
class CameraPose:
    """A pose of the left camera in a home."""

    scene: Scene
    T_world_camera: Pose3


def camera_poses(seeds: int, each: int = VIEWS_PER_HOME) -> Iterator[CameraPose]:
    """Camera poses in the homes of all seeds, a few in each."""
    for seed in range(seeds):
        scene = catalogue.load("home", seed)
        rng = np.random.default_rng([seed, 61])
        assert scene.start is not None
        places = [(scene.start.x, scene.start.y), *scene.goals]
        for k in range(each):
            x, y = places[k % len(places)]
            body = Pose2(x, y, float(rng.uniform(-math.pi, math.pi))).lifted()
            turned = head_rotation(float(rng.uniform(-1.0, 1.0)), float(rng.uniform(0.1, 0.7)))
            head = Pose3.from_rotation(turned, np.array([0.03, 0.0, EYE_M]))
            yield CameraPose(scene, body @ head)


def in_band(band: tuple[float, float], depth: np.ndarray) -> np.ndarray:
    """Mask of the depths within a range band."""
    return np.asarray((depth >= band[0]) & (depth < band[1]))


def _quantiles(parts: list[np.ndarray]) -> tuple[float, float]:
    """Median and 95th percentile, mm; NaN if empty."""
    values = np.concatenate(parts) if parts else np.zeros(0)
    if not len(values):
        return math.nan, math.nan
    half, most = np.percentile(1e3 * values, [50, 95])
    return float(half), float(most)


def renderer_errors(views: list[CameraPose], camera: Camera, say: Say) -> Outcome:
    """Depth errors of each renderer that works on this machine."""
    figures: dict[str, float] = {}
    table = ["depth error of the renderers, median / p95 mm"]
    for renderer in ("egl", "tiny"):
        if renderer == "egl" and choose_renderer("auto") != "egl":
            table.append("egl    does not work on this machine")
            continue
        errors: dict[tuple[float, float], list[np.ndarray]] = {band: [] for band in RENDERED_M}
        compared: list[np.ndarray] = []
        valid_count = 0
        for number, view in enumerate(views):
            with World(view.scene, renderer) as world:
                true = true_depth(world, camera, view.T_world_camera)
                error = np.abs(world.rendered_depth(camera, view.T_world_camera) - true)
            away = on_one_surface(true)
            good = away & np.isfinite(error)
            compared.append(np.where(good, error, np.inf)[away])  # a missing depth counts as wrong
            valid_count += int(np.isfinite(true).sum())
            for band, parts in errors.items():
                parts.append(error[good & in_band(band, true)])
            say(f"{renderer}: {number + 1} of {len(views)} views")
        cells = []
        for (low, high), parts in errors.items():
            half, most = _quantiles(parts)
            figures[f"{renderer}_depth_median_mm_{high:g}m"] = half
            cells.append(f"{low:g}-{high:g} m {half:.3f} / {most:.2f}")
        everywhere = np.concatenate(compared)
        figures[f"{renderer}_within_1mm_share"] = float((everywhere <= EXACT_M).mean())
        figures[f"{renderer}_judged_share"] = len(everywhere) / valid_count
        near = np.concatenate([p for band in RENDERED_M[:3] for p in errors[band]])
        figures[f"{renderer}_depth_mm"] = float(np.percentile(1e3 * near, 95))
        table.append(f"{renderer:<6} " + "   ".join(cells))
    return Outcome(figures, table)


def stereo_errors(views: list[CameraPose], robot: RobotConfig, say: Say) -> Outcome:
    """Depth errors of stereo: our matcher and OpenCV's two, on the same pairs."""
    config, baseline = robot.stereo_camera, robot.baseline_m
    camera = config.camera
    errors = {(m, band): [] for m in stereo.METHODS for band in STEREO_M}  # type: dict[tuple[str, tuple[float, float]], list[np.ndarray]]
    floor: dict[str, list[float]] = {method: [] for method in stereo.METHODS}
    for number, view in enumerate(views):
        rng = np.random.default_rng([number, 62])
        with World(view.scene) as world:
            left, right = stereo_pair(world, config, baseline, view.T_world_camera, rng)
            true = true_depth(world, camera, view.T_world_camera)
        height = (view.T_world_camera.apply((camera.rays * true[..., None]).reshape(-1, 3)))[:, 2]
        ground = np.abs(height.reshape(true.shape)) < 1e-3
        ground &= in_band((0.3, 3.0), true)
        pair = StereoView(left, right, baseline, camera)
        for method in stereo.METHODS:
            seen = stereo.depth(pair, stereo.StereoConfig(method=method)).z
            error = np.abs(seen - true)
            for band in STEREO_M:
                errors[method, band].append(
                    error[np.isfinite(error) & in_band(band, true) & on_one_surface(true)]
                )
            if ground.any():
                floor[method].append(float(np.isfinite(seen[ground]).mean()))
        say(f"stereo: {number + 1} of {len(views)} views")
    table = ["stereo, median / p95 mm (notes: OpenCV's two matchers, without reliability)"]
    for band, notes in STEREO_M.items():
        cells = [f"{m} {_mm(errors[m, band])}" for m in stereo.METHODS]
        reference = ", ".join(f"{m} {half}/{most}" for m, (half, most) in notes.items())
        table.append(f"{band[0]:g}-{band[1]:g} m  " + "   ".join(cells) + f"   ({reference})")
    shares = {method: float(np.mean(share)) for method, share in floor.items()}
    table.append("floor with a depth: " + ", ".join(f"{m} {s:.2f}" for m, s in shares.items()))
    figures = {
        f"stereo_median_mm_{band[1]:g}m": _quantiles(errors["block", band])[0] for band in STEREO_M
    }
    for band, notes in STEREO_M.items():
        for method, expected in notes.items():
            found = _quantiles(errors[method, band])
            for name, measured, noted in zip(("p50", "p95"), found, expected, strict=True):
                figures[f"{method}_{name}_off_{band[1]:g}m"] = abs(measured / noted - 1.0)
    figures |= {f"{method}_floor_share": shares[method] for method in FLOOR_SHARE}
    return Outcome(figures | {"stereo_floor_share": shares["block"]}, table)


def _mm(parts: list[np.ndarray]) -> str:
    half, most = _quantiles(parts)
    return f"{half:.1f} / {most:.0f}"


def tof_errors(views: list[CameraPose], say: Say) -> Outcome:
    """Temporal standard deviation and bias of the time-of-flight camera."""
    exact = replace(_EXACT, dark=0.0)
    spread: dict[tuple[float, float], list[np.ndarray]] = {band: [] for band in TOF_M}
    bias: dict[tuple[float, float], list[np.ndarray]] = {band: [] for band in TOF_M}
    for number, view in enumerate(views):
        caster = _caster(view.scene)
        camera = TofCamera(TofConfig(), np.random.default_rng([number, 63]))
        ideal = TofCamera(exact, np.random.default_rng(0))
        true = ideal.measure(caster, view.T_world_camera)[0].astype(np.float64)
        shots = np.stack([camera.measure(caster, view.T_world_camera)[0] for _ in range(SHOTS)])
        good = np.isfinite(shots).all(axis=0) & on_one_surface(true)
        for band in TOF_M:
            mask = good & in_band(band, true)
            spread[band].append(shots.var(axis=0, ddof=1)[mask])
            bias[band].append((shots.mean(axis=0) - true)[mask])
        say(f"time of flight: {number + 1} of {len(views)} views")
    figures: dict[str, float] = {}
    table = ["time of flight: temporal standard deviation (notes), bias, mm"]
    for band, notes in TOF_M.items():
        sigma = 1e3 * math.sqrt(float(np.mean(np.concatenate(spread[band]))))
        offset = 1e3 * float(np.median(np.concatenate(bias[band])))
        figures |= {f"tof_sigma_mm_{band[1]:g}m": sigma, f"tof_bias_mm_{band[1]:g}m": offset}
        figures[f"tof_sigma_off_{band[1]:g}m"] = abs(sigma / notes - 1.0)
        table.append(f"{band[0]:g}-{band[1]:g} m  {sigma:.1f} ({notes})   {offset:+.1f}")
    return Outcome(figures, table)


_EXACT = TofConfig(
    sub_rays=1, noise_m=0.0, floor_noise_m=0.0, stray_share=0.0, wiggling_m=0.0, pattern_m=0.0, bits=20
)  # fmt: skip


def _caster(scene: Scene) -> RayCaster:
    caster = RayCaster(scene)
    caster.place([mover.start for mover in scene.moving_objects])
    return caster


def wrapped_and_flying() -> Outcome:
    """A box in front of walls at 6 m and 2.7 m: plot, and numbers of wrapped, flying and motion-distorted pixels."""
    extent = (-1.0, -6.0, 8.0, 6.0)
    objects = (
        StaticObject("wall", (Box((6.5, 0.0, 1.5), (1.0, 12.0, 3.0)),), 0.8),
        StaticObject("near wall", (Box((2.9, -2.0, 1.5), (0.4, 4.0, 3.0)),), 0.8),
        StaticObject("box", (Box((1.4, 0.103, 0.3), (0.4, 0.5, 0.6)),), 0.6),
    )
    scene = Scene(
        "test", 0, extent, (FloorArea("planks/oak", extent),), objects, (), (), Pose2(), ()
    )
    pose = Pose3.from_rotation(head_rotation(0.0, 0.0), np.array([0.0, 0.0, EYE_M]))
    config = TofConfig(dark=0.0)
    measured = TofCamera(config, np.random.default_rng(64)).measure(_caster(scene), pose)[0]
    ideal = replace(_EXACT, dark=0.0, modulation_hz=1e6)  # wraps at 150 m
    true = TofCamera(ideal, np.random.default_rng(0)).measure(_caster(scene), pose)[0]
    far = on_one_surface(true) & (true > config.wrap_m)
    error = measured - true
    wrapped = far & (np.abs(error + config.wrap_m) < 0.1)
    outline = ~on_one_surface(true) & np.isfinite(true)
    off_both = np.minimum(np.abs(error), np.abs(error + config.wrap_m))
    flying = outline & (off_both > 0.1)
    caster = _caster(scene)
    turning = TofCamera(replace(config, integration_s=INTEGRATION_S), np.random.default_rng(64))
    motion = Motion(np.zeros(3), np.array([0.0, 0.0, TURNING_RADPS]))
    smeared = turning.measure_moving(
        (caster, motion.pose_after(pose, s)) for s in turning.instants
    )[0]
    artefact = (np.abs(smeared - measured) > 0.1) & ~flying
    return Outcome(
        {
            "wrapped_share": float(wrapped.sum() / max(far.sum(), 1)),
            "flying_pixels": float(flying.sum()),
            "motion_pixels": float(artefact.sum()),
        },
        drawings=[
            style.Drawing(
                "time-of-flight",
                "Ranges beyond c / 2f wrap, pixels on edges fly between both surfaces, and rotation distorts.",
                partial(_draw, measured, true, flying, smeared, config.wrap_m),
            )
        ],
    )


def _draw(
    measured: Float32[np.ndarray, "h w"],
    true: Float32[np.ndarray, "h w"],
    flying: Bool[np.ndarray, "h w"],
    smeared: Float32[np.ndarray, "h w"],
    wrap_m: float,
) -> Figure:
    figure, ((left, right), (lower, change)) = style.sheet(2, 2, 6.0)
    drawn = left.imshow(measured, cmap="viridis", vmin=0.0, vmax=3.0)
    left.plot(*np.nonzero(flying)[::-1], ".", markersize=1.5, color=style.WRONG)
    row = measured.shape[0] // 2 - 10
    left.axhline(row, color=style.INK, linewidth=0.8)
    left.set(title="measured range; flying pixels marked", xticks=[], yticks=[])
    left.grid(False)
    figure.colorbar(drawn, ax=left, label="m", shrink=0.8)
    shots, here = np.arange(measured.shape[1]), flying[row]
    right.plot(true[row], color=style.TRUTH, label="true range")
    right.plot(true[row] % wrap_m, ":", color=style.TRUTH, label=f"modulo {wrap_m:.2f} m")
    right.plot(measured[row], ".", markersize=3, color=style.ESTIMATE, label="measured")
    right.plot(shots[here], measured[row][here], "o", color=style.WRONG, label="flying")
    right.set(xlabel="column of the marked row, px", ylabel="m")
    style.legend(right, 4)
    lower.imshow(smeared, cmap="viridis", vmin=0.0, vmax=3.0)
    lower.axhline(row, color=style.INK, linewidth=0.8)
    turned = f"{TURNING_RADPS:g} rad/s over {1e3 * INTEGRATION_S:g} ms"
    lower.set(title=f"the same while turning, {turned}", xticks=[], yticks=[])
    lower.grid(False)
    change.plot(smeared[row] - measured[row], ".", markersize=3, color=style.WRONG)
    change.set(title="change by the rotation", xlabel="column of the marked row, px", ylabel="m")
    return figure


def run(seeds: int, say: Say, each: int = VIEWS_PER_HOME) -> Outcome:
    """Some views in the home of each seed."""
    robot = RobotConfig()
    views = list(camera_poses(seeds, each))
    parts = (
        renderer_errors(views, robot.stereo_camera.camera, say),
        stereo_errors(views, robot, say),
        tof_errors(views, say),
        range_errors([(view.scene, view.T_world_camera) for view in views], say),
        wrapped_and_flying(),
    )
    whole = combined(*((part.figures, part.table) for part in parts))
    return replace(whole, drawings=parts[-1].drawings)


def _near_the_notes() -> dict[str, Target]:
    """Targets by the figures of the notes, with the relative tolerance `OFF`."""
    names = [
        f"{method}_{name}_off_{band[1]:g}m"
        for band, notes in STEREO_M.items()
        for method in notes
        for name in ("p50", "p95")
    ]
    names += [f"tof_sigma_off_{band[1]:g}m" for band in TOF_M]
    floor = {f"{method}_floor_share": Target(">=", share) for method, share in FLOOR_SHARE.items()}
    return {name: Target("<=", OFF) for name in names} | floor


EXPERIMENT = Experiment(
    id="sensors",
    title="Errors of the simulated cameras: both renderers, stereo, time of flight, PyBullet's ranges",
    run=run,
    targets={
        "egl_depth_mm": Target("<=", 1.0),
        "tiny_depth_mm": Target("<=", 1.0),
        "egl_within_1mm_share": Target(">=", 0.99),
        "tiny_within_1mm_share": Target(">=", 0.99),
        "pybullet_range_median_mm": Target("<=", 1.0),
        "pybullet_range_p99_mm": Target("<=", 5.0),
        "wrapped_share": Target(">=", 0.99),
        "flying_pixels": Target(">", 0.0),
        "motion_pixels": Target(">", 0.0),
    }
    | _near_the_notes(),
    seeds=3,
)
