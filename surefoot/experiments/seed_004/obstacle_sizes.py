"""How wide and how far: rows of three to six boxes in panoramas of two views, beside the published table.

The head looks at the row twice, half of it each time, with encoders that are half a degree off; range has
all the errors of the camera's model, corrected as far as a calibration would. Rows, distances and widths are
those of the table; what else stands in the room, how bright it is, every error and all noise are drawn anew
by each seed. Both kinds of features carry the same chain; beside it what features achieve without laying
surfaces upon each other, and what the encoders alone would.

Source: seed 004, Table 4 and Fig. 8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, StitchConfig, stitch
from mapping.panorama.views import View, view_of_depth
from perception.depth import time_of_flight
from perception.features.pictures import amplitude_picture
from perception.primitives.frame import RangeView
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.rendering.rays import RayCaster
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes.rooms import walls
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.shapes import Box

from ...config.schema import CALIBRATED_TOF
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_trials

DISTANCES_M = (1.05, 1.29)
WIDTHS_M = (0.713, 0.954, 1.195, 1.428)
BOX_M = 0.238  # the side of a box that is seen; three make 71.3 cm
DEPTH_M, HEIGHT_M = 0.32, 0.32
ENCODER_DEG = 0.5  # deviation of pan and of tilt, each view on its own
YAWS_DEG = (15.0, -15.0)  # two views of 44 deg hold the widest row at the nearer distance
DOWN_DEG = 17.0  # seed 004: key pitch
CAMERA_HEIGHT_M = 0.55  # seed 004
LEVER_M = np.array([0.0, -0.035, 0.035])  # DARwIn-OP: camera about the neck, camera axes

# Published, cm: (distance, widths) for each true distance
PUBLISHED = {
    "mdghm": ((105.8, (71.68, 95.77, 118.42, 142.49)), (129.2, (69.43, 97.11, 119.24, 139.53))),
    "sift": ((105.75, (77.31, 100.88, 121.01, 142.49)), (130.0, (78.04, 101.38, 123.45, 142.15))),
}


def configs() -> dict[str, StitchConfig]:
    """The chains that are compared."""
    mdghm = StitchConfig()
    plain = replace(mdghm.pairs, sift=replace(mdghm.pairs.sift, method="difference"))
    sift = replace(mdghm, pairs=plain)
    return {
        "mdghm": mdghm,
        "sift": sift,
        "mdghm_features": replace(mdghm, surfaces=False),
        "sift_features": replace(sift, surfaces=False),
    }


def row(width_m: float, distance_m: float, seed: int) -> Scene:
    """A row of boxes with labels across the way, in a room with furniture behind."""
    rng = np.random.default_rng([seed, 60])
    extent = (-0.8, -1.7, 3.4, 1.7)
    count = round(width_m / BOX_M)
    side, off = width_m / count, float(rng.uniform(-0.03, 0.03))
    things = list(walls(extent, ("wall/white",) * 4))

    def add(name: str, centre: tuple[float, ...], size: tuple[float, ...], albedo: float) -> None:
        place, sides = (tuple(float(v) for v in values) for values in (centre, size))
        box = Box((place[0], place[1], place[2]), (sides[0], sides[1], sides[2]))
        things.append(StaticObject(name, (box,), albedo))

    for k in range(count):
        y = off - width_m / 2 + (k + 0.5) * side
        place = (distance_m + DEPTH_M / 2, y, HEIGHT_M / 2)
        add(f"box {k + 1}", place, (DEPTH_M, side, HEIGHT_M), float(rng.uniform(0.45, 0.75)))
        for _ in range(4):
            w, h = rng.uniform(0.03, 0.10, 2)
            aside = y + rng.uniform(-1.0, 1.0) * (side / 2 - w / 2 - 0.005)
            up = rng.uniform(h / 2 + 0.01, HEIGHT_M - h / 2 - 0.01)
            shade = float(rng.choice([0.1, 0.2, 0.95]))
            add("label", (distance_m - 0.0005, aside, up), (0.001, w, h), shade)
    for _ in range(12):
        w, h = rng.uniform(0.05, 0.30, 2)
        place = (rng.uniform(0.5, 3.2), rng.uniform(-1.5, 1.5), 0.0005)
        add("sheet", place, (w, h, 0.001), float(rng.choice([0.1, 0.2, 0.95])))
    for k in range(4):
        h = rng.uniform(0.3, 1.2)
        place = (rng.uniform(2.7, 3.1), -1.3 + 0.8 * k + rng.uniform(-0.2, 0.2), h / 2)
        size = (0.3, rng.uniform(0.2, 0.5), h)
        add(f"furniture {k + 1}", place, size, float(rng.uniform(0.3, 0.8)))
    area = (FloorArea("planks/pine", extent),)
    return Scene("row", seed, extent, area, tuple(things), (), (), Pose2(), ((3.0, 0.0),))


def two_views(scene: Scene, seed: int) -> list[View]:
    """Two views of a head whose encoders are off; priors are what they say."""
    caster = RayCaster(scene)
    caster.place([])
    rng = np.random.default_rng([seed, 61])
    camera = TofCamera(TofConfig(), rng)
    views = []
    for number, yaw in enumerate(YAWS_DEG):
        pan, tilt = math.radians(yaw), math.radians(DOWN_DEG)
        off = math.radians(ENCODER_DEG) * rng.standard_normal(2)
        range_m, amplitude = camera.measure(caster, _head(pan + off[0], tilt + off[1]))
        prior = _head(pan, tilt)
        view = RangeView(range_m, amplitude, camera.camera, prior)
        depth = time_of_flight.depth(view, CALIBRATED_TOF)
        picture = amplitude_picture(amplitude)
        views.append(view_of_depth(depth, 5.0, picture, prior, float(number)))
    return views


def _head(pan_rad: float, tilt_rad: float) -> Pose3:
    rotation = head_rotation(float(pan_rad), float(tilt_rad))
    return Pose3.from_rotation(rotation, np.array([0.0, 0.0, CAMERA_HEIGHT_M]) + rotation @ LEVER_M)


@dataclass(frozen=True)
class Reading:
    """What was measured of one row: widths and distance, m, each as estimate less truth, and in sigmas."""

    width_m: float
    distance_m: float
    height_m: float
    sigma_width_m: float


def measure(panorama: Panorama, views: list[View]) -> Reading | None:
    """The nearest obstacle straight ahead; None if there is none."""
    found = surroundings(panorama, views).obstacles
    ahead = [obstacle for obstacle in found if obstacle.left_rad > 0.0 > obstacle.right_rad]
    if not ahead:
        return None
    nearest = min(ahead, key=lambda obstacle: obstacle.distance_m)
    return Reading(nearest.width_m, nearest.distance_m, nearest.height_m, nearest.sigma_width_m)


def readings(seed: int) -> dict[tuple[str, int, int], Reading | None]:
    """Every chain at every distance and width, for one seed."""
    found = {}
    for d, distance in enumerate(DISTANCES_M):
        for w, width in enumerate(WIDTHS_M):
            views = two_views(row(width, distance, seed), seed)
            for name, config in configs().items():
                panorama = stitch(views, np.random.default_rng([seed, 62]), config)
                found[name, d, w] = measure(panorama, views)
    return found


def run(seeds: int, say: Say) -> Outcome:
    """Two distances, four widths, four chains a seed; about seven seconds a seed on one core."""
    everything: list[dict[tuple[str, int, int], Reading | None]] = []
    for found in run_trials(readings, [(seed,) for seed in range(seeds)]):
        everything.append(found)
        say(f"seed {len(everything) - 1}: {len(found)} rows measured")
    figures: dict[str, float] = {}
    for name in configs():
        figures |= _figures(name, everything)
    gap = figures["sift_width_mean_pct"] - figures["mdghm_width_mean_pct"]
    figures["sift_less_mdghm_pct"] = gap
    return Outcome(figures, _table(everything))


def _figures(
    name: str, everything: list[dict[tuple[str, int, int], Reading | None]]
) -> dict[str, float]:
    widths, distances, heights, sigmas = [], [], [], []
    missed = 0
    for found in everything:
        for (chain, d, w), reading in found.items():
            if chain != name:
                continue
            if reading is None:
                missed += 1
                continue
            widths.append(100.0 * (reading.width_m / WIDTHS_M[w] - 1.0))
            distances.append(100.0 * (reading.distance_m / DISTANCES_M[d] - 1.0))
            heights.append(1000.0 * abs(reading.height_m - HEIGHT_M))
            sigmas.append((reading.width_m - WIDTHS_M[w]) / reading.sigma_width_m)
    size = np.abs(widths + [100.0] * missed)
    far = np.abs(distances + [100.0] * missed)
    return {
        f"{name}_width_mean_pct": float(size.mean()),
        f"{name}_width_max_pct": float(size.max()),
        f"{name}_distance_mean_pct": float(far.mean()),
        f"{name}_distance_max_pct": float(far.max()),
        f"{name}_height_mean_mm": float(np.mean(heights)) if heights else math.nan,
        f"{name}_width_nees": float(np.mean(np.square(sigmas))) if sigmas else math.nan,
    }


def _table(everything: list[dict[tuple[str, int, int], Reading | None]]) -> list[str]:
    """The published table and ours beside it: estimates in cm, errors in % of the truth."""
    lines = [
        "cm (error in % of the truth); ours: mean over the seeds and mean absolute error",
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
    return lines


def _row(chain: str, d: int, everything: list[dict[tuple[str, int, int], Reading | None]]) -> str:
    of_widths = [
        [reading for found in everything if (reading := found[chain, d, w]) is not None]
        for w in range(len(WIDTHS_M))
    ]
    far = np.array([reading.distance_m for column in of_widths for reading in column])
    error = 100.0 * np.mean(np.abs(far / DISTANCES_M[d] - 1.0))
    cells = f"{100.0 * far.mean():9.2f} ({error:5.2f})"
    for column, true in zip(of_widths, WIDTHS_M, strict=True):
        sizes = np.array([reading.width_m for reading in column])
        error = 100.0 * np.mean(np.abs(sizes / true - 1.0))
        cells += f"{100.0 * sizes.mean():11.2f} ({error:4.2f})"
    what = "ours" if "features" not in chain else "features"
    return f"{chain.split('_')[0]:<6} {100 * DISTANCES_M[d]:4.0f} {what:<9} " + cells


EXPERIMENT = Experiment(
    id="004-E1",
    title="Table 4: width and distance of rows of boxes in panoramas of two views",
    run=run,
    targets={
        "mdghm_width_mean_pct": Target("<=", 0.8),
        "mdghm_width_max_pct": Target("<=", 2.0),
        "mdghm_distance_max_pct": Target("<=", 0.5),
    },
    published={
        "mdghm_width_mean_pct": 1.12,
        "mdghm_width_max_pct": 2.62,
        "mdghm_distance_max_pct": 0.76,
        "sift_width_mean_pct": 4.39,
        "sift_width_max_pct": 9.45,
        "sift_distance_max_pct": 0.78,
    },
    seeds=20,
)
