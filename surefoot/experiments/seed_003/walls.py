"""Floor detection where the floor is not the largest plane: in front of a wall, a table, a step or a ramp.

Depth images are ray cast with the noise of a Kinect, from cameras between 0.3 m and 1.6 m high. Each method detects
the floor with the prior of the joints and, for walls and tables, with the weak prior of a handheld camera. Views
without any floor must give no detection.

Source: ours; the methods are those of seed 003, section 3.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.depth.points import Points, from_depth
from perception.depth.structured_light import depth as structured_light
from perception.floor import choose
from perception.floor.choose import FloorConfig
from perception.floor.prior import handheld_prior
from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView
from perception.primitives.plane import Plane

from ...config.schema import CALIBRATED_DISTORTION
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.floor_views import FloorView, random_view
from ..support.simulated_depth import structured_light_sigma

CAMERA = Camera.from_view(240, 180, math.radians(60.0), math.radians(47.0))
REACH_M = 5.0
CORRECT_DEG, CORRECT_M = 1.0, 0.02
LEAST_FLOOR = {"wall": 0.06, "table": 0.06, "step": 0.15, "ramp": 0.15}  # share of the points
MOST_FLOOR = 0.45
METHODS = ("ransac", "hough")

Rays = Float[np.ndarray, "h w 3"]
RayLengths = Float[np.ndarray, "h w"]


@dataclass(frozen=True)
class FloorScene:
    """One view: points, prior and true plane."""

    kind: str
    points: Points
    view: FloorView


def block(
    origin: Float[np.ndarray, "3"], rays: Rays, low: list[float], high: list[float]
) -> RayLengths:
    """Ray parameter at which rays enter an axis-aligned block; infinite where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (np.array(low) - origin) / rays, (np.array(high) - origin) / rays
    enter = np.nanmax(np.minimum(one, other), axis=-1)
    leave = np.nanmin(np.maximum(one, other), axis=-1)
    return np.asarray(np.where((enter < leave) & (enter > 0.0), enter, np.inf))


def wall(view: FloorView, rays: Rays, rng: np.random.Generator) -> RayLengths:
    """A wall 1.8 to 2.5 m ahead."""
    with np.errstate(divide="ignore"):
        t = rng.uniform(1.8, 2.5) / rays[..., 0]
    return np.asarray(np.where(t > 0.0, t, np.inf))


def table(view: FloorView, rays: Rays, rng: np.random.Generator) -> RayLengths:
    """A table top below the camera, larger than the floor round it, on four legs."""
    top = view.floor.offset_m * rng.uniform(0.35, 0.65)
    x, y, edge = rng.uniform(0.25, 0.6), rng.uniform(-1.5, -0.4), rng.uniform(-0.1, 0.5)
    length = rng.uniform(1.0, 2.0)
    origin = view.T_world_camera.position
    t = block(origin, rays, [x, y, top - 0.03], [x + length, edge, top])
    for leg_x in (x + 0.05, x + length - 0.1):
        for leg_y in (y + 0.05, edge - 0.1):
            t = np.minimum(
                t, block(origin, rays, [leg_x, leg_y, 0.0], [leg_x + 0.05, leg_y + 0.05, top])
            )
    return t


def step(view: FloorView, rays: Rays, rng: np.random.Generator) -> RayLengths:
    """A platform one step higher that fills most of the image."""
    ahead = rng.uniform(0.6, 0.9) * max(view.floor.offset_m, 0.5)
    return block(
        view.T_world_camera.position,
        rays,
        [ahead, -5.0, 0.0],
        [9.0, 5.0, rng.uniform(0.10, 0.18)],
    )


def ramp(view: FloorView, rays: Rays, rng: np.random.Generator) -> RayLengths:
    """A slope of 8 to 15 deg that begins ahead and fills most of the image."""
    ahead = rng.uniform(0.6, 0.9) * max(view.floor.offset_m, 0.5)
    rise = math.tan(math.radians(rng.uniform(8.0, 15.0)))
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (-rise * ahead - view.floor.offset_m) / (rays[..., 2] - rise * rays[..., 0])
    return np.asarray(np.where((t > 0.0) & (t * rays[..., 0] > ahead), t, np.inf))


KINDS: dict[
    str, tuple[Callable[[FloorView, Rays, np.random.Generator], RayLengths], tuple[float, float]]
] = {
    "wall": (wall, (0.3, 1.5)),
    "table": (table, (0.9, 1.6)),
    "step": (step, (0.35, 1.2)),
    "ramp": (ramp, (0.35, 1.2)),
}
"""Name to the surface in view, and the range of camera heights, m."""


def draw(kind: str, rng: np.random.Generator) -> FloorScene:
    """A random view with enough floor, and with a plane larger than the floor."""
    build, heights = KINDS[kind]
    while True:
        view = random_view(rng, heights, (5.0, 45.0), pan_deg=10.0)
        rays = CAMERA.rays @ view.T_world_camera.rotation.T
        with np.errstate(divide="ignore"):
            ground = np.where(rays[..., 2] < -1e-6, -view.floor.offset_m / rays[..., 2], np.inf)
        t = build(view, rays, rng)
        z = np.minimum(t, ground)  # rays have unit depth, so t is depth
        seen = z < REACH_M
        floor = float(np.mean((ground < t)[seen])) if seen.any() else 0.0
        if LEAST_FLOOR[kind] <= floor <= MOST_FLOOR:
            break
    return FloorScene(kind, _measured(z, rng), view)


def bare_wall(rng: np.random.Generator) -> FloorScene:
    """A view of a wall with no floor in the field of view."""
    while True:
        view = random_view(rng, (0.3, 1.5), (-5.0, 10.0), pan_deg=10.0)
        rays = CAMERA.rays @ view.T_world_camera.rotation.T
        z = rng.uniform(0.5, 1.5) / rays[..., 0]
        if np.all(view.floor.offset_m + z * rays[..., 2] > 0.05):
            return FloorScene("bare wall", _measured(z, rng), view)


def _measured(z: RayLengths, rng: np.random.Generator) -> Points:
    sigma = structured_light_sigma(z)
    with np.errstate(invalid="ignore"):
        noisy = np.where(z < REACH_M, z + sigma * rng.standard_normal(z.shape), np.nan)
    return from_depth(structured_light(DepthView(noisy.astype(np.float32), CAMERA)), 0.15, REACH_M)


def settings(method: str) -> FloorConfig:
    """Of the floor search: rendered depth does not bend.

    Searched with the published bend of an RGB-D camera instead, 2 of 200 floors are off by 1.03 and 1.28 deg.
    """
    return FloorConfig(method=method, distortion=CALIBRATED_DISTORTION)


def is_floor(found: Plane | None, true: Plane) -> bool:
    """Whether a detected plane is the true floor, within `CORRECT_DEG` and `CORRECT_M`."""
    return (
        found is not None
        and math.degrees(found.angle_to(true)) <= CORRECT_DEG
        and abs(found.offset_m - true.offset_m) <= CORRECT_M
    )


def floors_correct(scene: FloorScene, rng: np.random.Generator) -> list[bool]:
    """Whether each method detects the true floor with each prior."""
    priors = [scene.view.prior]
    if scene.kind in ("wall", "table"):
        priors.append(handheld_prior(None))
    answers = []
    for method in METHODS:
        for prior in priors:
            found = choose.find(scene.points, prior, rng, settings(method), "depth")
            answers.append(is_floor(None if found is None else found.plane, scene.view.floor))
    return answers


def largest_plane_is_floor(scene: FloorScene) -> bool:
    """Whether the largest plane by Open3D is the floor."""
    import open3d as o3d

    o3d.utility.random.seed(0)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scene.points.xyz))
    a, b, c, d = cloud.segment_plane(0.01, 3, 1000)[0]
    sign = math.copysign(1.0, float(np.array([a, b, c]) @ scene.view.floor.normal))
    return is_floor(Plane(sign * np.array([a, b, c]), sign * d), scene.view.floor)


def run(seeds: int, say: Say) -> Outcome:
    """Per seed twelve walls, eight tables, two steps, two ramps and a view without floor."""
    share = {"wall": 12, "table": 8, "step": 2, "ramp": 2}
    ours: dict[str, list[bool]] = {kind: [] for kind in KINDS}
    baseline: dict[str, list[bool]] = {kind: [] for kind in KINDS}
    silent: list[bool] = []
    for seed in range(seeds):
        scene_rng, rng = np.random.default_rng([seed, 40]), np.random.default_rng([seed, 41])
        for kind, count in share.items():
            for _ in range(count):
                scene = draw(kind, scene_rng)
                ours[kind].append(all(floors_correct(scene, rng)))
                baseline[kind].append(largest_plane_is_floor(scene))
        bare = bare_wall(scene_rng)
        for method in METHODS:
            for prior in (bare.view.prior, handheld_prior(None)):
                found = choose.find(bare.points, prior, rng, settings(method), "depth")
                silent.append(found is None)
        say(f"{seed + 1} of {seeds} seeds")
    figures = {
        "right_floor_pct": 100.0 * float(np.mean(ours["wall"] + ours["table"])),
        "open3d_right_floor_pct": 100.0 * float(np.mean(baseline["wall"] + baseline["table"])),
        "none_where_no_floor_pct": 100.0 * float(np.mean(silent)),
        "views": float(len(ours["wall"] + ours["table"])),
    }
    table_lines = ["kind   views  ours correct %  largest plane correct % (Open3D)"]
    for kind in KINDS:
        table_lines.append(
            f"{kind:<6} {len(ours[kind]):5d}  {100 * np.mean(ours[kind]):14.1f}"
            f"  {100 * np.mean(baseline[kind]):12.1f}"
        )
        figures[f"{kind}_right_pct"] = 100.0 * float(np.mean(ours[kind]))
    return Outcome(figures, table_lines)


EXPERIMENT = Experiment(
    id="003-walls",
    title="Floor detection where another plane is larger: walls, tables, steps, ramps",
    run=run,
    targets={
        "right_floor_pct": Target(">=", 100.0),
        "none_where_no_floor_pct": Target(">=", 100.0),
    },
)
