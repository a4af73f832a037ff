"""Panoramas of a real camera without encoders, and sizes of real objects.

The panorama shows the kitchen of 7-Scenes, with 35 deg of rotation and 0.23 m of translation. For the sizes of a
cabinet, a carton and furniture see `object_sizes`; for the floor under given poses `panorama_floor`; for what the
pictures alone place, also if they are spoilt, `panorama_pictures`.

The rotation-only panorama assumes that the camera rotates on the spot, so that parallax is an error. The other one
estimates the position of each view, too, by features with depth and by registration of surfaces. Both use images alone;
given poses are used for evaluation only, after removing the mean difference in rotation.

Source: ours; the methods are those of Kang 2013 (seed 004), section 2.2.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from mapping.panorama.pairs import PairConfig
from mapping.panorama.stitching import StitchConfig, place
from mapping.panorama.views import View
from perception.features.mdghm_sift import SiftConfig
from perception.features.pictures import range_picture

from ...evaluation.metrics.averages import rms
from ..support.experiment import Experiment, Outcome, Say, Target, combined
from . import object_sizes, panorama_floor, panorama_pictures

SIFT = SiftConfig(upsample=False, most=1000)  # 640 x 480 pixels give enough features without
HAND_TRAVEL_M = 0.05  # motion of a handheld camera between overlapping views
ON_THE_SPOT = StitchConfig(pairs=PairConfig(sift=SIFT, travel_m=HAND_TRAVEL_M))
MOVING = StitchConfig(moving=True, pairs=PairConfig(sift=SIFT))


def kitchen(seeds: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Both kinds of panorama; features from colour with either gradient, and from range alone."""
    taken = panorama_pictures.shots("sevenscenes_redkitchen/pan")
    views, poses = [View(shot.depth, (shot.grey,)) for shot in taken], [shot.pose for shot in taken]
    say(f"{len(views)} views read")
    by_range = [
        View(view.depth, (range_picture(view.depth.z, 5.0),), None, view.stamp_s) for view in views
    ]
    plain = replace(ON_THE_SPOT.pairs, sift=replace(SIFT, method="difference"))
    fine = replace(
        ON_THE_SPOT.pairs, sift=replace(SIFT, upsample=True)
    )  # range images have few features
    contests = {
        "pan": (views, ON_THE_SPOT),
        "pan_moving": (views, MOVING),
        "pan_sift": (views, replace(ON_THE_SPOT, pairs=plain)),
        "pan_range": (by_range, replace(ON_THE_SPOT, pairs=fine)),
    }
    figures, table = {}, []
    for name, (pictures, config) in contests.items():
        runs = []
        for seed in range(max(1, min(seeds, 3)) if name in ("pan", "pan_moving") else 1):
            placed, links, _ = place(pictures, np.random.default_rng(seed), config)
            runs.append(panorama_pictures.rotation_errors_deg(placed, poses))
            say(f"{name}: {len(links)} pairs, rms {rms(runs[-1]):.2f} deg")
        figures[f"{name}_rms_deg"] = float(np.max([rms(run) for run in runs]))
        if name == "pan_range":
            share = float(np.mean(runs[0] < panorama_pictures.LOST_DEG))
            figures["pan_range_placed_share"] = share
            figures["pan_range_rms_deg"] = rms(runs[0][runs[0] < panorama_pictures.LOST_DEG])
        table.append(
            f"{name:<12} rms {figures[f'{name}_rms_deg']:.2f} deg"
            f"  worst view {max(float(run.max()) for run in runs):.2f} deg, {len(views)} views"
        )
    return figures, table


def run(seeds: int, say: Say, parts: int | None = None) -> Outcome:
    """Sizes, floor and pictures, two minutes; then the kitchen, two more, the worst of up to three runs.

    Args:
        seeds: Number of runs of the kitchen.
        say: Takes lines of progress.
        parts: Only the first parts; None: all.
    """
    every = (
        object_sizes.cabinet,
        object_sizes.carton,
        object_sizes.furniture,
        panorama_floor.run,
        panorama_pictures.run,
        partial(kitchen, seeds),
    )
    return combined(*(part(say) for part in every[:parts]))


EXPERIMENT = Experiment(
    id="real-panorama",
    title="Real cameras: panoramas without encoders, and sizes of objects from single views",
    run=run,
    targets={
        "pan_rms_deg": Target("<=", 1.6),
        "pan_moving_rms_deg": Target("<=", 0.8),
        "camera_height_error_max_m": Target("<=", 0.05),
        "other_height_error_max_m": Target("<=", 0.05),
        "placed_share_min": Target(">=", 0.9),
        "wrongly_placed": Target("<=", 0.0),
        "cabinet_height_median_mm": Target("<=", 10.0),
        "cabinet_width_median_mm": Target("<=", 25.0),
        "cabinet_length_median_mm": Target("<=", 25.0),
        "cabinet_height_p90_mm": Target("<=", 50.0),
        "cabinet_width_p90_mm": Target("<=", 50.0),
        "cabinet_length_p90_mm": Target("<=", 50.0),
        "carton_spread_m": Target("<=", 0.02),
        "furniture_error_m": Target("<=", 0.10),
    },
    seeds=1,
)
