"""Floor planes by Hough transform and RANSAC, from three sensors, and the effect of details of the fit.

Every view is simulated for stereo and time of flight, both calibrated as the robot's, and for structured light with
the noise of its model and a random distortion. The row "raw" is the time-of-flight camera without calibration: stray
light bends its depth beside every near object, which a distortion that is smooth over the image does not describe, so
its floors are too sure. It has no target. For comparison: seed 003's flow chart as printed, and least squares over the same stereo points in space
instead of in (u, v, disparity), where their noise is uniform.

Source: seed 003, section 3.
"""

from __future__ import annotations

import math
import time

import numpy as np
from jaxtyping import Float

from perception.depth import points, stereo, time_of_flight
from perception.depth.distortion import DistortionConfig
from perception.depth.points import Points
from perception.depth.structured_light import depth as structured_light
from perception.floor import choose
from perception.floor.choose import FloorConfig
from perception.floor.classify import FLOOR, classify
from perception.floor.flow_chart import find_as_printed
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth, DepthView
from perception.primitives.plane import Plane

from ...config.schema import CALIBRATED_DISTORTION, CALIBRATED_TOF
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.floor_views import (
    FLOOR_REACH_M,
    HEADER,
    FloorView,
    Score,
    SensorViews,
    render,
    row,
    score,
    summary,
)
from ..support.simulated_depth import FOCAL_SHARE, structured_light_bend, structured_light_sigma

VIEWS_A_SEED = 4
METHODS = ("ransac", "hough")
SENSORS = ("stereo", "tof", "depth")
RAW = "raw"  # time of flight without calibration
CALIBRATED = ("stereo", "tof")


def structured(view: FloorView, seen: SensorViews, rng: np.random.Generator) -> Depth:
    """Structured-light depth of the scene: every second pixel of the stereo camera, with a Kinect's errors."""
    height = seen.pair_height[::2, ::2]
    full = seen.pair.camera
    camera = Camera(320, 240, full.fx / 2, full.fy / 2, full.cx / 2, full.cy / 2)
    rays = camera.rays
    stretch = 1.0 + FOCAL_SHARE * rng.normal()  # the focal length is not known better
    true_rays = rays * np.array([stretch, stretch, 1.0])
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (height - view.floor.offset_m) / (true_rays @ view.floor.normal)
    sigma = structured_light_sigma(z)
    z = z * (1.0 + structured_light_bend(z, rays, rng))
    z = np.where(np.isfinite(z), z + sigma * rng.standard_normal(z.shape), np.nan)
    return structured_light(DepthView(z.astype(np.float32), camera))


def fit_in_space(cloud: Points, plane: Plane) -> Plane:
    """Unweighted least squares of point-to-plane distances over the points of a floor."""
    floor_points = cloud.xyz[classify(cloud, plane) == FLOOR]
    centroid = floor_points.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov((floor_points - centroid).T))
    normal = vectors[:, 0] * math.copysign(1.0, float(vectors[:, 0] @ plane.normal))
    return Plane(normal, -float(normal @ centroid))


def errors(planes: list[tuple[Plane | None, Plane]], name: str) -> dict[str, float]:
    """Median errors of (detected, true) pairs, and the share of views with a detection."""
    found = [(plane, true) for plane, true in planes if plane is not None]
    figures = {f"{name}_found_share": len(found) / max(len(planes), 1)}
    if found:
        figures[f"{name}_deg"] = float(np.median([np.degrees(p.angle_to(t)) for p, t in found]))
        figures[f"{name}_mm"] = 1e3 * float(
            np.median([abs(p.offset_m - t.offset_m) for p, t in found])
        )
    return figures


def run(seeds: int, say: Say) -> Outcome:
    """Four views per seed."""
    scores: dict[str, list[Score | None]] = {
        f"{s}_{m}": [] for s in (*SENSORS, RAW) for m in METHODS
    }
    printed: list[tuple[Plane | None, Plane]] = []
    spatial: list[tuple[Plane | None, Plane]] = []
    for number in range(VIEWS_A_SEED * seeds):
        seen = render(1000 + number)
        view, rng = seen.view, np.random.default_rng([number, 33])
        views: dict[str, tuple[Depth, Float[np.ndarray, "h w"]]] = {
            "stereo": (stereo.depth(seen.pair), seen.pair_height),
            "tof": (time_of_flight.depth(seen.range, CALIBRATED_TOF), seen.range_height),
            RAW: (time_of_flight.depth(seen.range), seen.range_height),
            "depth": (structured(view, seen, rng), seen.pair_height[::2, ::2].copy()),
        }
        for sensor, (depth, height) in views.items():
            cloud = points.from_depth(depth, 0.2, FLOOR_REACH_M)
            for method in METHODS:
                distortion = CALIBRATED_DISTORTION if sensor in CALIBRATED else DistortionConfig()
                config = FloorConfig(method=method, distortion=distortion)
                began = time.perf_counter()
                kind = "tof" if sensor == RAW else sensor
                found = choose.find(cloud, view.prior, rng, config, kind)
                spent = 1e3 * (time.perf_counter() - began)
                scores[f"{sensor}_{method}"].append(score(cloud, found, view, height, spent))
            if sensor == "stereo":
                printed.append((find_as_printed(cloud, view.prior, rng), view.floor))
                if found is not None:
                    spatial.append((fit_in_space(cloud, found.among_points), view.floor))
        say(f"{number + 1} of {VIEWS_A_SEED * seeds} views")
    figures: dict[str, float] = {}
    table = ["sensor method  " + HEADER]
    for name, method_scores in scores.items():
        figures |= summary(name, method_scores)
        sensor, method = name.split("_")
        table.append(f"{sensor:<6} {method:<7} " + row(name, figures))
    figures |= errors(printed, "hough_as_printed") | errors(spatial, "stereo_in_space")
    for name, words in (
        ("hough_as_printed", "flow chart as printed, stereo"),
        ("stereo_in_space", "least squares in space, stereo"),
    ):
        table.append(
            f"{words:<34} {figures.get(f'{name}_deg', math.nan):.3f} deg"
            f"  {figures.get(f'{name}_mm', math.nan):.2f} mm"
            f"  detected in {100 * figures[f'{name}_found_share']:.0f} % of the views"
        )
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="INT-3",
    title="Floor planes: Hough transform against RANSAC, for stereo, time of flight and structured light",
    run=run,
    targets={
        f"{sensor}_{method}_{name}": Target("<=", 1.25)
        for sensor in SENSORS
        for method in METHODS
        for name in ("plane_anees", "plane_anees_inverse")
    },
)
