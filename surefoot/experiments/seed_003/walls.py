"""Views in which the floor is not the largest plane: facing a wall, over a table, before a step or a ramp.

Drawn by rays with the noise of a Kinect, from cameras between a crawling robot's and a grown-up's. Every
view is asked twice by each method: with the floor expected where the joints have it, and, for walls and
tables, with no more than that the camera is held upright. Views that show no floor must give none.
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

from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.floor_views import Look, head

CAMERA = Camera.from_view(240, 180, math.radians(60.0), math.radians(47.0))
REACH_M = 5.0
RIGHT_DEG, RIGHT_M = 1.0, 0.02
LEAST_FLOOR = {"wall": 0.06, "table": 0.06, "step": 0.15, "ramp": 0.15}  # of the points
MOST_FLOOR = 0.45
METHODS = ("ransac", "hough")

Rays = Float[np.ndarray, "h w 3"]
Along = Float[np.ndarray, "h w"]


@dataclass(frozen=True)
class Scenery:
    """One view: points, what was known and what is true, shares of floor and of the largest rival."""

    kind: str
    points: Points
    look: Look
    floor_share: float
    rival_share: float


def block(origin: Float[np.ndarray, "3"], rays: Rays, low: list[float], high: list[float]) -> Along:
    """Ray parameter at which rays enter an upright block, infinite where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (np.array(low) - origin) / rays, (np.array(high) - origin) / rays
    enter = np.nanmax(np.minimum(one, other), axis=-1)
    leave = np.nanmin(np.maximum(one, other), axis=-1)
    return np.asarray(np.where((enter < leave) & (enter > 0.0), enter, np.inf))


def wall(look: Look, rays: Rays, rng: np.random.Generator) -> Along:
    """A wall 1.8 to 2.5 m ahead."""
    with np.errstate(divide="ignore"):
        t = rng.uniform(1.8, 2.5) / rays[..., 0]
    return np.asarray(np.where(t > 0.0, t, np.inf))


def table(look: Look, rays: Rays, rng: np.random.Generator) -> Along:
    """A table top below the camera, larger than the floor round it, on four legs."""
    top = look.floor.offset_m * rng.uniform(0.35, 0.65)
    x, y, edge = rng.uniform(0.25, 0.6), rng.uniform(-1.5, -0.4), rng.uniform(-0.1, 0.5)
    length = rng.uniform(1.0, 2.0)
    origin = look.T_world_camera.position
    t = block(origin, rays, [x, y, top - 0.03], [x + length, edge, top])
    for leg_x in (x + 0.05, x + length - 0.1):
        for leg_y in (y + 0.05, edge - 0.1):
            t = np.minimum(
                t, block(origin, rays, [leg_x, leg_y, 0.0], [leg_x + 0.05, leg_y + 0.05, top])
            )
    return t


def step(look: Look, rays: Rays, rng: np.random.Generator) -> Along:
    """A landing a step higher that fills most of the view."""
    ahead = rng.uniform(0.6, 0.9) * max(look.floor.offset_m, 0.5)
    return block(
        look.T_world_camera.position,
        rays,
        [ahead, -5.0, 0.0],
        [9.0, 5.0, rng.uniform(0.10, 0.18)],
    )


def ramp(look: Look, rays: Rays, rng: np.random.Generator) -> Along:
    """A slope of 8 to 15 deg that begins ahead and fills most of the view."""
    ahead = rng.uniform(0.6, 0.9) * max(look.floor.offset_m, 0.5)
    rise = math.tan(math.radians(rng.uniform(8.0, 15.0)))
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (-rise * ahead - look.floor.offset_m) / (rays[..., 2] - rise * rays[..., 0])
    return np.asarray(np.where((t > 0.0) & (t * rays[..., 0] > ahead), t, np.inf))


KINDS: dict[str, tuple[Callable[[Look, Rays, np.random.Generator], Along], tuple[float, float]]] = {
    "wall": (wall, (0.3, 1.5)),
    "table": (table, (0.9, 1.6)),
    "step": (step, (0.35, 1.2)),
    "ramp": (ramp, (0.35, 1.2)),
}
"""What stands there, and how high the camera is, m."""


def draw(kind: str, rng: np.random.Generator) -> Scenery:
    """A view in which there is enough floor, and a larger plane than the floor."""
    build, heights = KINDS[kind]
    while True:
        look = head(rng, heights, (5.0, 45.0), pan_deg=10.0)
        rays = CAMERA.rays @ look.T_world_camera.rotation.T
        with np.errstate(divide="ignore"):
            ground = np.where(rays[..., 2] < -1e-6, -look.floor.offset_m / rays[..., 2], np.inf)
        t = build(look, rays, rng)
        z = np.minimum(t, ground)  # rays have length 1 along the axis: t is depth
        seen = z < REACH_M
        floor = float(np.mean((ground < t)[seen])) if seen.any() else 0.0
        if LEAST_FLOOR[kind] <= floor <= MOST_FLOOR:
            break
    return Scenery(kind, _measured(z, rng), look, floor, 1.0 - floor)


def bare_wall(rng: np.random.Generator) -> Scenery:
    """A wall so near, or a camera so level, that no floor is in view."""
    while True:
        look = head(rng, (0.3, 1.5), (-5.0, 10.0), pan_deg=10.0)
        rays = CAMERA.rays @ look.T_world_camera.rotation.T
        z = rng.uniform(0.5, 1.5) / rays[..., 0]
        if np.all(look.floor.offset_m + z * rays[..., 2] > 0.05):
            return Scenery("bare wall", _measured(z, rng), look, 0.0, 1.0)


def _measured(z: Along, rng: np.random.Generator) -> Points:
    sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2
    with np.errstate(invalid="ignore"):
        noisy = np.where(z < REACH_M, z + sigma * rng.standard_normal(z.shape), np.nan)
    return from_depth(structured_light(DepthView(noisy.astype(np.float32), CAMERA)), 0.15, REACH_M)


def is_right(found: Plane | None, true: Plane) -> bool:
    """Whether it is the floor: no table, wall, step or ramp is so near to it."""
    return (
        found is not None
        and math.degrees(found.angle_to(true)) <= RIGHT_DEG
        and abs(found.offset_m - true.offset_m) <= RIGHT_M
    )


def asked(view: Scenery, rng: np.random.Generator) -> list[bool]:
    """Whether each method, with each prior, is right."""
    priors = [view.look.prior]
    if view.kind in ("wall", "table"):
        priors.append(handheld_prior(None))
    answers = []
    for method in METHODS:
        for prior in priors:
            found = choose.find(view.points, prior, rng, FloorConfig(method=method), "depth")
            answers.append(is_right(None if found is None else found.plane, view.look.floor))
    return answers


def largest_is_right(view: Scenery) -> bool:
    """Whether Open3D's largest plane is the floor."""
    import open3d as o3d

    o3d.utility.random.seed(0)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(view.points.xyz))
    a, b, c, d = cloud.segment_plane(0.01, 3, 1000)[0]
    sign = math.copysign(1.0, float(np.array([a, b, c]) @ view.look.floor.normal))
    return is_right(Plane(sign * np.array([a, b, c]), sign * d), view.look.floor)


def run(seeds: int, say: Say) -> Outcome:
    """Twenty views a seed of walls and tables; two of steps, two of ramps and a bare wall more."""
    share = {"wall": 12, "table": 8, "step": 2, "ramp": 2}
    ours: dict[str, list[bool]] = {kind: [] for kind in KINDS}
    peer: dict[str, list[bool]] = {kind: [] for kind in KINDS}
    silent: list[bool] = []
    for seed in range(seeds):
        scenes, rng = np.random.default_rng([seed, 40]), np.random.default_rng([seed, 41])
        for kind, count in share.items():
            for _ in range(count):
                view = draw(kind, scenes)
                ours[kind].append(all(asked(view, rng)))
                peer[kind].append(largest_is_right(view))
        bare = bare_wall(scenes)
        for method in METHODS:
            for prior in (bare.look.prior, handheld_prior(None)):
                found = choose.find(bare.points, prior, rng, FloorConfig(method=method), "depth")
                silent.append(found is None)
        say(f"{seed + 1} of {seeds} rooms")
    figures = {
        "right_floor_pct": 100.0 * float(np.mean(ours["wall"] + ours["table"])),
        "open3d_right_floor_pct": 100.0 * float(np.mean(peer["wall"] + peer["table"])),
        "none_where_no_floor_pct": 100.0 * float(np.mean(silent)),
        "views": float(len(ours["wall"] + ours["table"])),
    }
    table_lines = ["kind   views  ours right %  largest plane right % (Open3D)"]
    for kind in KINDS:
        table_lines.append(
            f"{kind:<6} {len(ours[kind]):5d}  {100 * np.mean(ours[kind]):12.1f}"
            f"  {100 * np.mean(peer[kind]):12.1f}"
        )
        figures[f"{kind}_right_pct"] = 100.0 * float(np.mean(ours[kind]))
    return Outcome(figures, table_lines)


EXPERIMENT = Experiment(
    id="003-walls",
    title="The floor and not the largest plane: walls, tables, steps, ramps",
    run=run,
    targets={
        "right_floor_pct": Target(">=", 100.0),
        "none_where_no_floor_pct": Target(">=", 100.0),
    },
)
