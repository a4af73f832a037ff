"""Width and distance of rows of three to six boxes in panoramas of two views, compared with the published table.

The head takes two views that each show half of the row, with encoder errors of half a degree; ranges have all errors of
the camera model after calibration. Rows, distances and widths are those of the table; the rest of the room, albedos,
errors and noise depend on the seed. The same processing runs with MDGHM-SIFT and with SIFT, with and without
registration of surfaces.

Source: Kang 2013 (seed 004), Table 4 and Fig. 8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, StitchConfig, stitch
from mapping.panorama.views import View, view_of_depth
from perception.depth import time_of_flight
from perception.primitives.frame import RangeView
from perception.primitives.pose import Pose2
from sim.rendering.rays import RayCaster
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes.rooms import walls
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.shapes import Box

from ...config.schema import CALIBRATED_TOF
from ...evaluation.metrics.averages import mean
from ..support.columns import Row
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_all
from .panorama_scenes import ENCODER_DEG, head_pose

DISTANCES_M = (1.05, 1.29)
WIDTHS_M = (0.713, 0.954, 1.195, 1.428)
BOX_M = 0.238  # visible side of a box; three make 71.3 cm
DEPTH_M, HEIGHT_M = 0.32, 0.32
YAWS_DEG = (15.0, -15.0)  # two views of 44 deg hold the widest row at the nearer distance
DOWN_DEG = 17.0  # seed 004: key pitch

# Published, cm: (distance, widths) for each true distance
PUBLISHED = {
    "mdghm": ((105.8, (71.68, 95.77, 118.42, 142.49)), (129.2, (69.43, 97.11, 119.24, 139.53))),
    "sift": ((105.75, (77.31, 100.88, 121.01, 142.49)), (130.0, (78.04, 101.38, 123.45, 142.15))),
}

PAPER = {  # errors of Table 4, recomputed in % of the true size
    "mdghm_width_mean_pct": 1.12,
    "mdghm_width_max_pct": 2.62,
    "mdghm_distance_max_pct": 0.76,
    "sift_width_mean_pct": 4.39,
    "sift_width_max_pct": 9.45,
    "sift_distance_max_pct": 0.78,
}


def configs() -> dict[str, StitchConfig]:
    """Name to the stitching settings that are compared."""
    mdghm = StitchConfig()
    plain = replace(mdghm.pairs, sift=replace(mdghm.pairs.sift, method="difference"))
    sift = replace(mdghm, pairs=plain)
    return {
        "mdghm": mdghm,
        "sift": sift,
        "mdghm_features": replace(mdghm, surfaces=False),
        "sift_features": replace(sift, surfaces=False),
        "encoders": replace(mdghm, features=False, surfaces=False),
    }


def row_scene(width_m: float, distance_m: float, seed: int) -> Scene:
    """A row of boxes with labels across the path, in a room with furniture behind it."""
    rng = np.random.default_rng([seed, 60])
    extent = (-0.8, -1.7, 3.4, 1.7)
    count = round(width_m / BOX_M)
    side, offset = width_m / count, float(rng.uniform(-0.03, 0.03))
    objects = list(walls(extent, ("wall/white",) * 4))

    def add(name: str, centre: tuple[float, ...], size: tuple[float, ...], albedo: float) -> None:
        position, sides = (tuple(float(v) for v in values) for values in (centre, size))
        box = Box((position[0], position[1], position[2]), (sides[0], sides[1], sides[2]))
        objects.append(StaticObject(name, (box,), albedo))

    for k in range(count):
        y = offset - width_m / 2 + (k + 0.5) * side
        position = (distance_m + DEPTH_M / 2, y, HEIGHT_M / 2)
        add(f"box {k + 1}", position, (DEPTH_M, side, HEIGHT_M), float(rng.uniform(0.45, 0.75)))
        for _ in range(4):
            w, h = rng.uniform(0.03, 0.10, 2)
            label_y = y + rng.uniform(-1.0, 1.0) * (side / 2 - w / 2 - 0.005)
            up = rng.uniform(h / 2 + 0.01, HEIGHT_M - h / 2 - 0.01)
            shade = float(rng.choice([0.1, 0.2, 0.95]))
            add("label", (distance_m - 0.0005, label_y, up), (0.001, w, h), shade)
    for _ in range(12):
        w, h = rng.uniform(0.05, 0.30, 2)
        position = (rng.uniform(0.5, 3.2), rng.uniform(-1.5, 1.5), 0.0005)
        add("sheet", position, (w, h, 0.001), float(rng.choice([0.1, 0.2, 0.95])))
    for k in range(4):
        h = rng.uniform(0.3, 1.2)
        position = (rng.uniform(2.7, 3.1), -1.3 + 0.8 * k + rng.uniform(-0.2, 0.2), h / 2)
        size = (0.3, rng.uniform(0.2, 0.5), h)
        add(f"furniture {k + 1}", position, size, float(rng.uniform(0.3, 0.8)))
    area = (FloorArea("planks/pine", extent),)
    return Scene("row", seed, extent, area, tuple(objects), (), (), Pose2(), ((3.0, 0.0),))


def two_views(scene: Scene, seed: int) -> list[View]:
    """Two views with encoder errors; the priors are the encoders' poses."""
    caster = RayCaster(scene)
    caster.place([])
    rng = np.random.default_rng([seed, 61])
    camera = TofCamera(TofConfig(), rng)
    views = []
    for number, yaw in enumerate(YAWS_DEG):
        pan, tilt = math.radians(yaw), math.radians(DOWN_DEG)
        offset = math.radians(ENCODER_DEG) * rng.standard_normal(2)
        range_m, amplitude = camera.measure(caster, head_pose(pan + offset[0], tilt + offset[1]))
        prior = head_pose(pan, tilt)
        view = RangeView(range_m, amplitude, camera.camera, prior)
        depth = time_of_flight.depth(view, CALIBRATED_TOF)
        views.append(view_of_depth(depth, 5.0, prior=prior, stamp_s=float(number)))
    return views


@dataclass(frozen=True)
class Measurement:
    """Measured width, distance and height of one row, and the standard deviation of the width, m."""

    width_m: float
    distance_m: float
    height_m: float
    sigma_width_m: float


Measurements = dict[tuple[str, int, int], Measurement | None]
"""By settings, distance and width; None where no obstacle was found."""


def nearest_ahead(panorama: Panorama, views: list[View]) -> Measurement | None:
    """The nearest obstacle ahead; None if there is none."""
    found = surroundings(panorama, views).obstacles
    ahead = [obstacle for obstacle in found if obstacle.left_rad > 0.0 > obstacle.right_rad]
    if not ahead:
        return None
    nearest = min(ahead, key=lambda obstacle: obstacle.distance_m)
    return Measurement(nearest.width_m, nearest.distance_m, nearest.height_m, nearest.sigma_width_m)


def measure_all(seed: int) -> Measurements:
    """Measurements by all settings at all distances and widths, for one seed."""
    found = {}
    for d, distance in enumerate(DISTANCES_M):
        for w, width in enumerate(WIDTHS_M):
            views = two_views(row_scene(width, distance, seed), seed)
            for name, config in configs().items():
                panorama = stitch(views, np.random.default_rng([seed, 62]), config)
                found[name, d, w] = nearest_ahead(panorama, views)
    return found


def run(seeds: int, say: Say) -> Outcome:
    """Two distances, four widths and five settings per seed; about seven seconds per seed on one core."""
    everything = run_all(measure_all, [(seed,) for seed in range(seeds)], say, "seeds")
    figures: dict[str, float] = {}
    for name in configs():
        figures |= _figures(name, everything)
    gap = figures["sift_width_mean_pct"] - figures["mdghm_width_mean_pct"]
    figures["sift_less_mdghm_pct"] = gap
    return Outcome(figures, _table(everything), COLUMNS)


def _figures(name: str, everything: list[Measurements]) -> dict[str, float]:
    widths, distances, heights, sigmas = [], [], [], []
    missed = 0
    for found in everything:
        for (chain, d, w), measured in found.items():
            if chain != name:
                continue
            if measured is None:
                missed += 1
                continue
            widths.append(100.0 * (measured.width_m / WIDTHS_M[w] - 1.0))
            distances.append(100.0 * (measured.distance_m / DISTANCES_M[d] - 1.0))
            heights.append(1000.0 * abs(measured.height_m - HEIGHT_M))
            sigmas.append((measured.width_m - WIDTHS_M[w]) / measured.sigma_width_m)
    width_error = np.abs(widths + [100.0] * missed)
    distance_error = np.abs(distances + [100.0] * missed)
    return {
        f"{name}_width_mean_pct": float(width_error.mean()),
        f"{name}_width_max_pct": float(width_error.max()),
        f"{name}_distance_mean_pct": float(distance_error.mean()),
        f"{name}_distance_max_pct": float(distance_error.max()),
        f"{name}_height_mean_mm": mean(heights),
        f"{name}_width_nees": float(np.mean(np.square(sigmas))) if sigmas else math.nan,
    }


def _table(everything: list[Measurements]) -> list[str]:
    """The published table and ours: estimates in cm, errors in % of the truth."""
    lines = [
        "cm (error in % of the truth); ours: mean over the seeds, and mean absolute error",
        f"{'':<22}{'distance':>16}" + "".join(f"{100 * w:>18.1f}" for w in WIDTHS_M),
    ]
    for name in ("mdghm", "sift"):
        for d, true in enumerate(DISTANCES_M):
            distance, widths = PUBLISHED[name][d]
            cells = [f"{distance:9.2f} ({distance / true - 100.0:5.2f})"]
            cells += [
                f"{value:11.2f} ({value / w - 100.0:4.2f})"
                for value, w in zip(widths, WIDTHS_M, strict=True)
            ]
            lines.append(f"{name:<6} {100 * true:4.0f} published " + "".join(cells))
            for chain in (name, f"{name}_features"):
                lines.append(_row(chain, d, everything))
    lines += [_row("encoders", d, everything) for d in range(len(DISTANCES_M))]
    return lines


def _row(chain: str, d: int, everything: list[Measurements]) -> str:
    of_widths = [
        [measured for found in everything if (measured := found[chain, d, w]) is not None]
        for w in range(len(WIDTHS_M))
    ]
    distances = np.array([measured.distance_m for column in of_widths for measured in column])
    error = 100.0 * np.mean(np.abs(distances / DISTANCES_M[d] - 1.0))
    cells = f"{100.0 * distances.mean():9.2f} ({error:5.2f})"
    for column, true in zip(of_widths, WIDTHS_M, strict=True):
        sizes = np.array([measured.width_m for measured in column])
        error = 100.0 * np.mean(np.abs(sizes / true - 1.0))
        cells += f"{100.0 * sizes.mean():11.2f} ({error:4.2f})"
    what = "features" if "features" in chain else "alone" if chain == "encoders" else "ours"
    return f"{chain.split('_')[0]:<8} {100 * DISTANCES_M[d]:4.0f} {what:<9} " + cells


COLUMNS: tuple[Row, ...] = tuple(
    (f"{words}, {kind}, %", paper, published, ours)
    for kind, name in (("MDGHM-SIFT", "mdghm"), ("SIFT", "sift"))
    for words, paper, published, ours in (
        ("width error, mean", PAPER[f"{name}_width_mean_pct"], f"{name}_features_width_mean_pct", f"{name}_width_mean_pct"),
        ("width error, largest", PAPER[f"{name}_width_max_pct"], f"{name}_features_width_max_pct", f"{name}_width_max_pct"),
        ("distance error, largest", PAPER[f"{name}_distance_max_pct"], f"{name}_features_distance_max_pct",
         f"{name}_distance_max_pct"),
    )
)  # fmt: skip

EXPERIMENT = Experiment(
    id="004-E1",
    title="Width and distance of rows of boxes in panoramas of two views (Kang 2013, Table 4)",
    run=run,
    targets={
        "mdghm_width_mean_pct": Target("<=", 0.8),
        "mdghm_width_max_pct": Target("<=", 2.0),
        "mdghm_distance_max_pct": Target("<=", 0.5),
        "mdghm_features_width_mean_pct": Target("<=", 1.12),
        "mdghm_features_width_max_pct": Target("<=", 2.62),
        "sift_features_width_mean_pct": Target("<=", 4.39),
        "sift_features_width_max_pct": Target("<=", 9.45),
        "encoders_width_mean_pct": Target("<=", 1.12),
        "encoders_width_max_pct": Target("<=", 2.62),
    },
    published={
        **PAPER,
        **{k.replace("_", "_features_", 1): v for k, v in PAPER.items() if "width" in k},
    },
    seeds=20,
)
