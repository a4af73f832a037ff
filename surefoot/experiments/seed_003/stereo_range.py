"""Depth by stereo from 0.2 to 4 m, on textured boxes whose faces are parallel to the images.

Every view shows boxes side by side at different distances, rendered with the robot's own stereo pair. The true depth
is ray cast into the scene.

Source: seed 003, experiment E2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.stats import rankdata

from perception.depth import stereo
from perception.primitives.frame import StereoView
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.robot import RobotConfig
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes.rooms import walls
from sim.sensors.cameras import stereo_pair
from sim.shapes import Box
from sim.world import World

from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.simulated_depth import true_depth

DISTANCES_M = (0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
EXTENT = (-0.4, -2.0, 4.8, 2.0)
CAMERA_M = 0.38  # height of the robot's camera while it walks
FACES = (
    "cardboard/kraft",
    "fabric/mustard",
    "books/walnut",
    "wood/pine",
    "fabric/plum",
    "rug/teal",
)
FLOORINGS = ("planks/oak", "rug/rust", "tiles/grey", "planks/pine")
FACE_ANGLE = 0.24  # width of a face divided by its distance; four fit side by side
SAME_M = 1e-3  # a pixel shows a face if its depth agrees within this
WRONG_PX = 1.0  # disparity error of a wrong pixel; seed 003, E2


def scene(distances: Float[np.ndarray, "k"], seed: int) -> Scene:
    """A room with a box face at each distance ahead of the origin, from left to right."""
    rng = np.random.default_rng([seed, 32])
    boxes = []
    places = FACE_ANGLE * 1.1 * (np.arange(len(distances)) - (len(distances) - 1) / 2)
    for number, (z, place) in enumerate(zip(distances.tolist(), places.tolist(), strict=True)):
        wide = FACE_ANGLE * z
        top = CAMERA_M + z * float(rng.uniform(0.1, 0.3))
        bottom = max(0.0, CAMERA_M - 0.4 * z)
        box = Box(
            (z + 0.05, -place * z, (top + bottom) / 2),
            (0.1, wide, top - bottom),
            0.0,
            str(rng.choice(FACES)),
        )
        boxes.append(StaticObject(f"box {number + 1}", (box,)))
    floor = (FloorArea(str(rng.choice(FLOORINGS)), EXTENT),)
    bare = walls(EXTENT, ("wall/white", "wall/sage", "wall/cream", "wall/sky"))
    return Scene("faces", seed, EXTENT, floor, bare + tuple(boxes), (), (), Pose2(), ())


def views(
    seeds: int,
) -> Iterator[tuple[StereoView, Float[np.ndarray, "h w"], Float[np.ndarray, "k"]]]:
    """Stereo pairs, the true depth of each pixel, and the distances of the faces they show, m."""
    robot = RobotConfig()
    config = robot.stereo_camera
    pose = Pose3.from_rotation(head_rotation(0.0, 0.0), np.array([0.0, 0.0, CAMERA_M]))
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 33])
        for distances in np.array_split(rng.permutation(DISTANCES_M), 3):
            with World(scene(distances, seed)) as world:
                left, right = stereo_pair(world, config, robot.baseline_m, pose, rng)
                depth = true_depth(world, config.camera, pose)
            yield StereoView(left, right, robot.baseline_m, config.camera), depth, distances


def roc_area(score: Float[np.ndarray, "n"], wrong: np.ndarray) -> float:
    """Area under the ROC curve: the share of (correct, wrong) pixel pairs in which the correct one scores higher.

    Ties count half; NaN if either kind is missing.
    """
    rank = rankdata(score)
    right, many = int(np.sum(~wrong)), int(np.sum(wrong))
    if right == 0 or many == 0:
        return math.nan
    return float((rank[~wrong].sum() - right * (right + 1) / 2) / (right * many))


def run(seeds: int, say: Say) -> Outcome:
    """About 25 s per seed, mostly for rendering the textures."""
    off: dict[float, list[np.ndarray]] = {z: [] for z in DISTANCES_M}
    shown: dict[float, int] = dict.fromkeys(DISTANCES_M, 0)
    scores, faults, normalised = [], [], []
    config = stereo.StereoConfig()
    for number, (view, true, distances) in enumerate(views(seeds)):
        say(f"view {number + 1} of {3 * seeds}")
        matched, seen = stereo.disparity(view, config), stereo.depth(view, config)
        fB = view.camera.fx * view.baseline_m
        there = np.isfinite(matched.disparity_px) & np.isfinite(true)
        error = np.where(there, matched.disparity_px - fB / true, np.nan)
        scores.append(matched.reliability[there].astype(np.float64))
        faults.append(np.abs(error[there]) > WRONG_PX)
        accepted = np.isfinite(seen.z)
        right = accepted & (np.abs(error) <= WRONG_PX)
        normalised.append((error[right] / matched.sigma_px[right]).astype(np.float64))
        for z in distances.tolist():
            face = np.abs(true - z) < SAME_M
            shown[z] += int(face.sum())
            off[z].append(np.abs(seen.z[face & accepted] / true[face & accepted] - 1.0))
    median = {z: 100.0 * _median(np.concatenate(parts)) for z, parts in off.items()}
    figures = {
        "error_pct_2m": max(value for z, value in median.items() if z <= 2.0),
        "error_pct_4m": median[4.0],
        "reliability_auc": roc_area(np.concatenate(scores), np.concatenate(faults)),
        "normalised_error": float(np.sqrt(np.mean(np.concatenate(normalised) ** 2))),
        "wrong_of_all_pct": 100.0 * float(np.mean(np.concatenate(faults))),
        "wrong_of_accepted_pct": 100.0
        * float(
            np.mean(np.concatenate(faults)[np.concatenate(scores) >= config.least_reliability])
        ),
    }
    table = ["distance   median error   accepted"]
    for z, value in median.items():
        share = sum(map(len, off[z])) / max(shown[z], 1)
        table.append(f"{z:6.2f} m   {value:9.2f} %   {100 * share:6.0f} %")
    return Outcome(figures, table)


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else math.nan


EXPERIMENT = Experiment(
    id="003-E2",
    title="Stereo depth on textured faces from 0.2 to 4 m, and whether the reliability predicts wrong pixels",
    run=run,
    targets={
        "error_pct_2m": Target("<=", 2.0),
        "error_pct_4m": Target("<=", 5.0),
        "reliability_auc": Target(">=", 0.85),
    },
    seeds=4,
)
