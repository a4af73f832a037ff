"""Two ways to think of a plane, three sensors, and what the details of the fit are worth.

Every view is seen by stereo and time of flight from the simulator, and by structured light with the noise
and the scale error that its model claims. Beside them: the flow chart to the letter, and least squares
over the same stereo points in space instead of in (u, v, disparity), where their noise is even.
"""

from __future__ import annotations

import math
import time

import numpy as np
from jaxtyping import Float

from perception.depth import points, stereo, time_of_flight
from perception.depth.points import Points
from perception.depth.structured_light import depth as structured_light
from perception.floor import choose
from perception.floor.choose import FloorConfig
from perception.floor.classify import FLOOR, classify
from perception.floor.flow_chart import find_as_printed
from perception.floor.refine import RefineConfig
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth, DepthView
from perception.primitives.plane import Plane

from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.floor_views import (
    FLOOR_REACH_M,
    HEADER,
    Look,
    Score,
    Seen,
    judged,
    row,
    see,
    summary,
)

VIEWS_A_SEED = 4
METHODS = ("ransac", "hough")
SENSORS = ("stereo", "tof", "depth")


def structured(look: Look, seen: Seen, rng: np.random.Generator) -> Depth:
    """The scene by structured light: the stereo camera's pixels, every second, with a Kinect's errors."""
    height = seen.pair_height[::2, ::2]
    full = seen.pair.camera
    camera = Camera(320, 240, full.fx / 2, full.fy / 2, full.cx / 2, full.cy / 2)
    rays = camera.rays
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (height - look.floor.offset_m) / (rays @ look.floor.normal)
    shared = RefineConfig().shared("depth")
    scale, right, down = rng.normal(size=3) * [shared.scale, shared.bend, shared.bend]
    sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2
    z = z * (1.0 + scale + right * rays[..., 0] + down * rays[..., 1])
    z = np.where(np.isfinite(z), z + sigma * rng.standard_normal(z.shape), np.nan)
    return structured_light(DepthView(z.astype(np.float32), camera))


def in_space(cloud: Points, plane: Plane) -> Plane:
    """Least squares of distances in space over the points of a floor, all alike."""
    mine = cloud.xyz[classify(cloud, plane) == FLOOR]
    middle = mine.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov((mine - middle).T))
    normal = vectors[:, 0] * math.copysign(1.0, float(vectors[:, 0] @ plane.normal))
    return Plane(normal, -float(normal @ middle))


def errors(planes: list[tuple[Plane | None, Plane]], name: str) -> dict[str, float]:
    """Medians of (found, true) pairs, and the share that was found at all."""
    found = [(plane, true) for plane, true in planes if plane is not None]
    figures = {f"{name}_found_share": len(found) / max(len(planes), 1)}
    if found:
        figures[f"{name}_deg"] = float(np.median([np.degrees(p.angle_to(t)) for p, t in found]))
        figures[f"{name}_mm"] = 1e3 * float(
            np.median([abs(p.offset_m - t.offset_m) for p, t in found])
        )
    return figures


def run(seeds: int, say: Say) -> Outcome:
    """Four views a seed."""
    scores: dict[str, list[Score | None]] = {f"{s}_{m}": [] for s in SENSORS for m in METHODS}
    printed: list[tuple[Plane | None, Plane]] = []
    spatial: list[tuple[Plane | None, Plane]] = []
    for number in range(VIEWS_A_SEED * seeds):
        seen = see(1000 + number)
        look, rng = seen.look, np.random.default_rng([number, 33])
        views: dict[str, tuple[Depth, Float[np.ndarray, "h w"]]] = {
            "stereo": (stereo.depth(seen.pair), seen.pair_height),
            "tof": (time_of_flight.depth(seen.range), seen.range_height),
            "depth": (structured(look, seen, rng), seen.pair_height[::2, ::2].copy()),
        }
        for sensor, (depth, height) in views.items():
            cloud = points.from_depth(depth, 0.2, FLOOR_REACH_M)
            for method in METHODS:
                config = FloorConfig(method=method)
                began = time.perf_counter()
                found = choose.find(cloud, look.prior, rng, config, sensor)
                spent = 1e3 * (time.perf_counter() - began)
                scores[f"{sensor}_{method}"].append(judged(cloud, found, look, height, spent))
            if sensor == "stereo":
                printed.append((find_as_printed(cloud, look.prior, rng), look.floor))
                if found is not None:
                    spatial.append((in_space(cloud, found.among_points), look.floor))
        say(f"{number + 1} of {VIEWS_A_SEED * seeds} views")
    figures: dict[str, float] = {}
    table = ["sensor method  " + HEADER]
    for name, mine in scores.items():
        figures |= summary(name, mine)
        sensor, method = name.split("_")
        table.append(f"{sensor:<6} {method:<7} " + row(name, figures))
    figures |= errors(printed, "hough_as_printed") | errors(spatial, "stereo_in_space")
    for name, words in (
        ("hough_as_printed", "flow chart to the letter, stereo"),
        ("stereo_in_space", "least squares in space, stereo"),
    ):
        table.append(
            f"{words:<34} {figures.get(f'{name}_deg', math.nan):.3f} deg"
            f"  {figures.get(f'{name}_mm', math.nan):.2f} mm"
            f"  found in {100 * figures[f'{name}_found_share']:.0f} % of the views"
        )
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="INT-3",
    title="Hough against RANSAC, stereo against time of flight and structured light",
    run=run,
    targets={
        f"{sensor}_{method}_{name}": Target("<=", 1.25)
        for sensor in SENSORS
        for method in METHODS
        for name in ("plane_anees", "plane_anees_inverse")
    },
)
