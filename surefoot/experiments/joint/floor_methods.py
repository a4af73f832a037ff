"""Floor planes by Hough transform, RANSAC and seed 003's flow chart as published, from three sensors.

Every view is simulated for stereo and time of flight, both calibrated as the robot's, and for structured light with
the noise of its model and a random distortion. The row "raw" is the time-of-flight camera without calibration: stray
light bends its depth beside every near object, which a distortion that is smooth over the image does not describe, so
its floors are too sure, and its targets are missed.

"printed" is the published system: the flow chart with the two tilts about the predicted up. `printed_hough_share` is
the share of its views by stereo and by time of flight in which its plane is within `FOUND_DEG` and `FOUND_M` of the
truth; the bend of structured light alone moves a floor that far, whoever finds it.
For comparison: the flow chart with the formula in (theta, phi) to the letter, and least squares over the same stereo
points in space instead of in (u, v, disparity), where their noise is uniform.

The covariance of "printed" was chosen on views 2000 to 2019; these are views 1000 and on.

Source: seed 003, section 3. It prints no numbers.
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
from perception.floor import choose, flow_chart
from perception.floor.choose import FloorConfig
from perception.floor.classify import FLOOR, classify
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
OURS = ("ransac", "hough")
METHODS = (*OURS, "printed")
SENSORS = ("stereo", "tof", "depth")
RAW = "raw"  # time of flight without calibration
CALIBRATED = ("stereo", "tof")
FOUND_DEG, FOUND_M = 0.5, 0.01  # of the truth: a step of 1 m then lands within 1 cm of its height


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


Planes = list[tuple[Plane | None, Plane]]
"""The floor found in every view, and the true one."""


def is_found(plane: Plane | None, true: Plane) -> bool:
    """Whether a plane is the floor."""
    return (
        plane is not None
        and math.degrees(plane.angle_to(true)) <= FOUND_DEG
        and abs(plane.offset_m - true.offset_m) <= FOUND_M
    )


def errors(planes: Planes, name: str) -> dict[str, float]:
    """Share of views in which the floor is found, and median errors of all planes that were claimed."""
    claimed = [(plane, true) for plane, true in planes if plane is not None]
    share = sum(is_found(*one) for one in planes) / max(len(planes), 1)
    figures = {f"{name}_share": share}
    if claimed:
        figures[f"{name}_deg"] = float(np.median([np.degrees(p.angle_to(t)) for p, t in claimed]))
        figures[f"{name}_mm"] = 1e3 * float(
            np.median([abs(p.offset_m - t.offset_m) for p, t in claimed])
        )
    return figures


def run(seeds: int, say: Say) -> Outcome:
    """Four views per seed."""
    scores: dict[str, list[Score | None]] = {
        f"{s}_{m}": [] for s in (*SENSORS, RAW) for m in METHODS
    }
    found_by: dict[str, Planes] = {method: [] for method in METHODS}
    literal: Planes = []
    spatial: Planes = []
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
                plane = None if found is None else found.plane
                if sensor in CALIBRATED:
                    found_by[method].append((plane, view.floor))
                if sensor == "stereo" and method == "hough" and found is not None:
                    spatial.append((fit_in_space(cloud, found.among_points), view.floor))
            if sensor in CALIBRATED:
                fit = flow_chart.find(cloud, view.prior, rng, literal=True)
                literal.append((None if fit is None else fit.plane, view.floor))
        say(f"{number + 1} of {VIEWS_A_SEED * seeds} views")
    figures: dict[str, float] = {}
    table = ["sensor method  " + HEADER]
    for name, method_scores in scores.items():
        figures |= summary(name, method_scores)
        sensor, method = name.split("_")
        table.append(f"{sensor:<6} {method:<7} " + row(name, figures))
    for method, planes in found_by.items():
        figures |= errors(planes, f"{method}{'_hough' if method == 'printed' else ''}")
    figures |= errors(literal, "literal_hough") | errors(spatial, "stereo_in_space")
    for name, words in (
        ("printed_hough", "flow chart, two tilts about predicted up"),
        ("literal_hough", "flow chart, (theta, phi) to the letter"),
        ("stereo_in_space", "least squares in space, stereo"),
    ):
        table.append(
            f"{words:<40} {figures.get(f'{name}_deg', math.nan):.3f} deg"
            f"  {figures.get(f'{name}_mm', math.nan):.2f} mm"
            f"  floor found in {100 * figures[f'{name}_share']:.0f} % of the views"
        )
    return Outcome(figures, table, COLUMNS)


COLUMNS = (
    ("share of views with the floor found", None, "printed_hough_share", "hough_share"),
    ("stereo, angle error, median, deg", None, "stereo_printed_plane_deg_median",
     "stereo_hough_plane_deg_median"),
    ("stereo, height error, median, mm", None, "stereo_printed_plane_mm_median",
     "stereo_hough_plane_mm_median"),
    ("tof, angle error, median, deg", None, "tof_printed_plane_deg_median",
     "tof_hough_plane_deg_median"),
    ("tof, height error, median, mm", None, "tof_printed_plane_mm_median",
     "tof_hough_plane_mm_median"),
)  # fmt: skip

EXPERIMENT = Experiment(
    id="INT-3",
    title="Floor planes: Hough transform against RANSAC, for stereo, time of flight and structured light",
    run=run,
    targets={
        "printed_hough_share": Target(">=", 0.95),
        **{
            f"{sensor}_{method}_{name}": Target("<=", 1.25)
            for sensor in (*SENSORS, RAW)
            for method in OURS
            for name in ("plane_anees", "plane_anees_inverse")
        },
    },
)
