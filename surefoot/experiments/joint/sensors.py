"""The simulated cameras against rays: depth of each renderer, stereo by three matchers, time of flight.

Views are taken from the start and the goals of furnished homes, in random directions of the head. A
renderer's depth is compared where a pixel and its neighbours lie on one surface: on an outline the two may
meet different things. Told is how much of the picture that is, and how much of it is right to a millimetre,
at any range. Stereo and time of flight are told as two figures a range, in the notes' own form; the figures
in parentheses are those of the notes that the models were built from, and `_off` is the share by which ours
differ from them. A picture shows what a time-of-flight camera cannot see rightly: ranges beyond c / 2f come
back that much too near, pixels on an edge fly between both sides, and while the camera turns the four
pictures of one measurement do not belong together.

Source: seed 003, E2 (ranges); seed 004, Table 3 (SR-4000).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy import ndimage

from perception.depth import stereo
from perception.primitives.camera import Camera
from perception.primitives.frame import StereoView
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.rendering import pictures
from sim.rendering.motion import Motion
from sim.rendering.rays import RayCaster
from sim.robot import RobotConfig
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes import catalogue
from sim.sensors.cameras import stereo_pair
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.shapes import Box
from sim.world import World

from ...report.plots import style
from ..seed_003.stereo_range import true_depth
from ..support.experiment import Experiment, Outcome, Say, Target

PICTURES = Path("runs/experiments/sensors")
EYE_M = 0.383  # of the robot while it walks
LOOKS = 6  # a home
TURNING_RADPS, INTEGRATION_S = 1.0, 0.03  # ours: a head that sweeps, and an SR-4000 indoors
SHOTS = 8  # of time of flight, for its deviation
OUTLINE_M = 0.03  # neighbours further apart than this lie on different surfaces
RENDERED_M = ((0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 5.5))
STEREO_M = {  # notes: p50 and p95 in mm of OpenCV's two
    (0.2, 0.5): {"bm": (1, 3), "sgbm": (1, 3)},
    (0.5, 1.0): {"bm": (1, 5), "sgbm": (3, 9)},
    (1.0, 1.5): {"bm": (5, 19), "sgbm": (9, 26)},
    (2.0, 3.0): {"bm": (14, 106), "sgbm": (37, 117)},
    (3.0, 4.0): {"bm": (29, 231), "sgbm": (76, 250)},
}
FLOOR_SHARE = {"bm": 0.84, "sgbm": 0.98}  # notes: at least so much of the floor has a depth
EXACT_M = 0.001  # notes: what a renderer may differ from rays
OFF = 0.5  # ours: how far, as a share, a figure may be from the notes' own
TOF_M = {(0.3, 1.0): 4, (1.0, 1.5): 6, (1.5, 2.0): 11, (2.0, 3.0): 18}  # notes: temporal sigma, mm


@dataclass(frozen=True)
class Look:
    """A pose of the left camera, and the home it looks at."""

    scene: Scene
    T_world_camera: Pose3


def looks(seeds: int) -> Iterator[Look]:
    """Poses in every home, the same for the same seed."""
    for seed in range(seeds):
        scene = catalogue.load("home", seed)
        rng = np.random.default_rng([seed, 61])
        assert scene.start is not None
        places = [(scene.start.x, scene.start.y), *scene.goals]
        for k in range(LOOKS):
            x, y = places[k % len(places)]
            body = Pose2(x, y, float(rng.uniform(-math.pi, math.pi))).lifted()
            turned = head_rotation(float(rng.uniform(-1.0, 1.0)), float(rng.uniform(0.1, 0.7)))
            head = Pose3.from_rotation(turned, np.array([0.03, 0.0, EYE_M]))
            yield Look(scene, body @ head)


def on_one_surface(depth: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels whose neighbours continue their depth: the second difference is small either way."""
    filled = np.where(np.isfinite(depth), depth, 1e3)
    bends = [np.abs(ndimage.convolve1d(filled, [1.0, -2.0, 1.0], axis=axis)) for axis in (0, 1)]
    calm = np.maximum(*bends) < OUTLINE_M
    return np.asarray(ndimage.binary_erosion(calm) & np.isfinite(depth))


def within(band: tuple[float, float], depth: np.ndarray) -> np.ndarray:
    """Which depths lie in a band."""
    return np.asarray((depth >= band[0]) & (depth < band[1]))


def _quantiles(parts: list[np.ndarray]) -> tuple[float, float]:
    """Median and 95th percentile in mm; NaN where nothing was seen."""
    values = np.concatenate(parts) if parts else np.zeros(0)
    if not len(values):
        return math.nan, math.nan
    half, most = np.percentile(1e3 * values, [50, 95])
    return float(half), float(most)


def rendered(views: list[Look], camera: Camera, say: Say) -> Outcome:
    """Depth of each renderer that works here, against rays."""
    figures: dict[str, float] = {}
    table = ["depth of the renderers against rays, median / p95 mm"]
    for renderer in ("egl", "tiny"):
        if renderer == "egl" and pictures.choose_renderer("auto") != "egl":
            table.append("egl    does not work on this machine")
            continue
        errors: dict[tuple[float, float], list[np.ndarray]] = {band: [] for band in RENDERED_M}
        judged: list[np.ndarray] = []
        met = 0
        for number, look in enumerate(views):
            with World(look.scene, renderer) as world:
                true = true_depth(world, camera, look.T_world_camera)
                error = np.abs(world.rendered_depth(camera, look.T_world_camera) - true)
            away = on_one_surface(true)
            good = away & np.isfinite(error)
            judged.append(np.where(good, error, np.inf)[away])  # what it leaves out is wrong
            met += int(np.isfinite(true).sum())
            for band, parts in errors.items():
                parts.append(error[good & within(band, true)])
            say(f"{renderer}: {number + 1} of {len(views)} views")
        cells = []
        for (low, high), parts in errors.items():
            half, most = _quantiles(parts)
            figures[f"{renderer}_depth_median_mm_{high:g}m"] = half
            cells.append(f"{low:g}-{high:g} m {half:.3f} / {most:.2f}")
        everywhere = np.concatenate(judged)
        figures[f"{renderer}_within_1mm_share"] = float((everywhere <= EXACT_M).mean())
        figures[f"{renderer}_judged_share"] = len(everywhere) / met
        near = np.concatenate([p for band in RENDERED_M[:3] for p in errors[band]])
        figures[f"{renderer}_depth_mm"] = float(np.percentile(1e3 * near, 95))
        table.append(f"{renderer:<6} " + "   ".join(cells))
    return Outcome(figures, table)


def matched(views: list[Look], robot: RobotConfig, say: Say) -> Outcome:
    """Depth by stereo: our matcher and OpenCV's two, on the same pairs."""
    config, baseline = robot.stereo_camera, robot.baseline_m
    camera = config.camera
    errors = {(m, band): [] for m in stereo.METHODS for band in STEREO_M}  # type: dict[tuple[str, tuple[float, float]], list[np.ndarray]]
    floor: dict[str, list[float]] = {method: [] for method in stereo.METHODS}
    for number, look in enumerate(views):
        rng = np.random.default_rng([number, 62])
        with World(look.scene) as world:
            left, right = stereo_pair(world, config, baseline, look.T_world_camera, rng)
            true = true_depth(world, camera, look.T_world_camera)
        height = (look.T_world_camera.apply((camera.rays * true[..., None]).reshape(-1, 3)))[:, 2]
        ground = np.abs(height.reshape(true.shape)) < 1e-3
        ground &= within((0.3, 3.0), true)
        pair = StereoView(left, right, baseline, camera)
        for method in stereo.METHODS:
            seen = stereo.depth(pair, stereo.StereoConfig(method=method)).z
            error = np.abs(seen - true)
            for band in STEREO_M:
                errors[method, band].append(
                    error[np.isfinite(error) & within(band, true) & on_one_surface(true)]
                )
            if ground.any():
                floor[method].append(float(np.isfinite(seen[ground]).mean()))
        say(f"stereo: {number + 1} of {len(views)} views")
    table = ["stereo, median / p95 mm (notes: OpenCV's two without a reliability)"]
    for band, notes in STEREO_M.items():
        cells = [f"{m} {_mm(errors[m, band])}" for m in stereo.METHODS]
        told = ", ".join(f"{m} {half}/{most}" for m, (half, most) in notes.items())
        table.append(f"{band[0]:g}-{band[1]:g} m  " + "   ".join(cells) + f"   ({told})")
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


def ranged(views: list[Look], say: Say) -> Outcome:
    """Deviation from shot to shot and bias of the time-of-flight camera."""
    exact = replace(_EXACT, dark=0.0)
    spread: dict[tuple[float, float], list[np.ndarray]] = {band: [] for band in TOF_M}
    bias: dict[tuple[float, float], list[np.ndarray]] = {band: [] for band in TOF_M}
    for number, look in enumerate(views):
        caster = _caster(look.scene)
        camera = TofCamera(TofConfig(), np.random.default_rng([number, 63]))
        ideal = TofCamera(exact, np.random.default_rng(0))
        true = ideal.measure(caster, look.T_world_camera)[0].astype(np.float64)
        shots = np.stack([camera.measure(caster, look.T_world_camera)[0] for _ in range(SHOTS)])
        good = np.isfinite(shots).all(axis=0) & on_one_surface(true)
        for band in TOF_M:
            mine = good & within(band, true)
            spread[band].append(shots.var(axis=0, ddof=1)[mine])
            bias[band].append((shots.mean(axis=0) - true)[mine])
        say(f"time of flight: {number + 1} of {len(views)} views")
    figures: dict[str, float] = {}
    table = ["time of flight: deviation from shot to shot (notes), bias, mm"]
    for band, notes in TOF_M.items():
        sigma = 1e3 * math.sqrt(float(np.mean(np.concatenate(spread[band]))))
        off = 1e3 * float(np.median(np.concatenate(bias[band])))
        figures |= {f"tof_sigma_mm_{band[1]:g}m": sigma, f"tof_bias_mm_{band[1]:g}m": off}
        figures[f"tof_sigma_off_{band[1]:g}m"] = abs(sigma / notes - 1.0)
        table.append(f"{band[0]:g}-{band[1]:g} m  {sigma:.1f} ({notes})   {off:+.1f}")
    return Outcome(figures, table)


_EXACT = TofConfig(
    sub_rays=1, noise_m=0.0, floor_noise_m=0.0, stray_share=0.0, wiggling_m=0.0, pattern_m=0.0, bits=20
)  # fmt: skip


def _caster(scene: Scene) -> RayCaster:
    caster = RayCaster(scene)
    caster.place([mover.start for mover in scene.moving_objects])
    return caster


def wrapped_and_flying() -> Outcome:
    """A box before a wall at 6 m and one at 2.7 m: the picture; how many pixels wrap, fly, are wrong by motion."""
    extent = (-1.0, -6.0, 8.0, 6.0)
    things = (
        StaticObject("wall", (Box((6.5, 0.0, 1.5), (1.0, 12.0, 3.0)),), 0.8),
        StaticObject("near wall", (Box((2.9, -2.0, 1.5), (0.4, 4.0, 3.0)),), 0.8),
        StaticObject("box", (Box((1.4, 0.103, 0.3), (0.4, 0.5, 0.6)),), 0.6),
    )
    scene = Scene(
        "test", 0, extent, (FloorArea("planks/oak", extent),), things, (), (), Pose2(), ()
    )
    pose = Pose3.from_rotation(head_rotation(0.0, 0.0), np.array([0.0, 0.0, EYE_M]))
    config = TofConfig(dark=0.0)
    measured = TofCamera(config, np.random.default_rng(64)).measure(_caster(scene), pose)[0]
    ideal = replace(_EXACT, dark=0.0, modulation_hz=1e6)  # wraps at 150 m: the truth
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
    _draw(measured, true, flying, smeared, config.wrap_m)
    return Outcome(
        {
            "wrapped_share": float(wrapped.sum() / max(far.sum(), 1)),
            "flying_pixels": float(flying.sum()),
            "motion_pixels": float(artefact.sum()),
        },
        [f"picture: {PICTURES / 'time-of-flight.png'}"],
    )


def _draw(
    measured: Float32[np.ndarray, "h w"],
    true: Float32[np.ndarray, "h w"],
    flying: Bool[np.ndarray, "h w"],
    smeared: Float32[np.ndarray, "h w"],
    wrap_m: float,
) -> None:
    with style.styled():
        figure, ((left, right), (lower, off)) = style.sheet(2, 2, 6.0)
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
        off.plot(smeared[row] - measured[row], ".", markersize=3, color=style.WRONG)
        off.set(title="what the turn changes", xlabel="column of the marked row, px", ylabel="m")
    style.save(figure, PICTURES / "time-of-flight.png")


def run(seeds: int, say: Say) -> Outcome:
    """Six views in each of so many homes."""
    robot = RobotConfig()
    views = list(looks(seeds))
    parts = [
        rendered(views, robot.stereo_camera.camera, say),
        matched(views, robot, say),
        ranged(views, say),
        wrapped_and_flying(),
    ]
    figures = {name: value for part in parts for name, value in part.figures.items()}
    return Outcome(figures, [line for part in parts for line in part.table])


def _near_the_notes() -> dict[str, Target]:
    """The notes' own figures, each to be met within `OFF` of itself."""
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
    title="The simulated cameras against rays: both renderers, stereo, time of flight",
    run=run,
    targets={
        "egl_depth_mm": Target("<=", 1.0),
        "tiny_depth_mm": Target("<=", 1.0),
        "egl_within_1mm_share": Target(">=", 0.99),
        "tiny_within_1mm_share": Target(">=", 0.99),
        "wrapped_share": Target(">=", 0.99),
        "flying_pixels": Target(">", 0.0),
        "motion_pixels": Target(">", 0.0),
    }
    | _near_the_notes(),
    seeds=3,
)
