"""Floor detection up to 3 m from the stereo pair of seed 003: plane, covariance and classes of the points.

Fifty head poses over textured floors with boxes on about 35 % of the image; Hough transform and RANSAC. Disparities
come from rendered images with sensor noise.

Source: seed 003, section 6, E1.
"""

from __future__ import annotations

import time

import numpy as np

from perception.depth import points, stereo
from perception.floor import choose
from perception.floor.choose import FloorConfig

from ...config.schema import CALIBRATED_DISTORTION
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.floor_views import FLOOR_REACH_M, HEADER, Score, render, row, score, summary

POSES_A_SEED = 5
METHODS = ("ransac", "hough")
NEAREST_M = 0.2  # seed 003


def run(seeds: int, say: Say) -> Outcome:
    """Five poses per seed."""
    scores: dict[str, list[Score | None]] = {method: [] for method in METHODS}
    for number in range(POSES_A_SEED * seeds):
        images = render(number)
        cloud = points.from_depth(stereo.depth(images.pair), NEAREST_M, FLOOR_REACH_M)
        for method in METHODS:
            config = FloorConfig(method=method, distortion=CALIBRATED_DISTORTION)
            rng = np.random.default_rng([number, 32])
            began = time.perf_counter()
            found = choose.find(cloud, images.view.prior, rng, config, "stereo")
            spent = 1e3 * (time.perf_counter() - began)
            scores[method].append(score(cloud, found, images.view, images.pair_height, spent))
        say(f"{number + 1} of {POSES_A_SEED * seeds} poses")
    figures: dict[str, float] = {}
    table = ["method   " + HEADER]
    for method in METHODS:
        figures |= summary(method, scores[method])
        table.append(f"{method:<8} " + row(method, figures))
    return Outcome(figures, table)


BOUNDS = {
    "plane_deg_median": Target("<=", 0.1),
    "plane_deg_max": Target("<=", 0.5),
    "plane_mm_median": Target("<=", 1.0),
    "plane_mm_max": Target("<=", 5.0),
    "floor_precision": Target(">=", 0.97),
    "floor_recall": Target(">=", 0.97),
    "plane_anees": Target("<=", 1.25),
    "plane_anees_inverse": Target("<=", 1.25),
    "floors_found_share": Target(">=", 1.0),
}

EXPERIMENT = Experiment(
    id="003-E1",
    title="Floor detection up to 3 m: 50 head poses, from stereo images to plane and classes",
    run=run,
    targets={f"{method}_{name}": bound for method in METHODS for name, bound in BOUNDS.items()},
)
