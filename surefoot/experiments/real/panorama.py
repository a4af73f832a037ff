"""Panoramas of a real camera without encoders, and sizes of real objects.

The panorama shows the kitchen of 7-Scenes, with 35 deg of rotation and 0.23 m of translation; for the sizes of a
cabinet, a carton and furniture see `object_sizes`.

The rotation-only panorama assumes that the camera rotates on the spot, so that parallax is an error. The other one
estimates the position of each view, too, by features with depth and by registration of surfaces. Both use images alone;
given poses are used for evaluation only, after removing the mean difference in rotation.

Source: ours; the methods are those of Kang 2013 (seed 004), section 2.2.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from mapping.panorama.adjustment import Placed
from mapping.panorama.pairs import PairConfig
from mapping.panorama.stitching import StitchConfig, place
from mapping.panorama.views import View
from perception.depth import structured_light
from perception.features.mdghm_sift import SiftConfig
from perception.features.pictures import range_picture
from perception.primitives.pose import Pose3

from ...evaluation.metrics.trajectory import rms
from ...recordings.open import open_recording
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Say, Target, combined
from . import object_sizes

SIFT = SiftConfig(upsample=False, most=1000)  # 640 x 480 pixels give enough features without
LOST_DEG = 180.0  # error of a view that was not placed
HAND_TRAVEL_M = 0.05  # motion of a handheld camera between overlapping views
ON_THE_SPOT = StitchConfig(pairs=PairConfig(sift=SIFT, travel_m=HAND_TRAVEL_M))
MOVING = StitchConfig(moving=True, pairs=PairConfig(sift=SIFT))


def kitchen_views(say: Say) -> tuple[list[View], list[Pose3]]:
    """The views of the kitchen in grey levels, and the given poses."""
    recording = open_recording(real_data.folder("sevenscenes_redkitchen") / "pan")
    views, poses = [], []
    for frame in recording.frames():
        assert frame.depth is not None, "the recording has depth in every frame"
        assert frame.colour is not None, "the recording has colour in every frame"
        assert frame.T_world_camera is not None, "the recording gives every pose"
        depth = structured_light.depth(frame.depth)
        grey = cv2.cvtColor(frame.colour.rgb, cv2.COLOR_RGB2GRAY).astype(np.uint8)
        views.append(View(depth, (grey,), None, frame.stamp_s))
        poses.append(frame.T_world_camera)
    say(f"{len(views)} views read")
    return views, poses


def rotation_errors_deg(placed: list[Placed | None], true: list[Pose3]) -> np.ndarray:
    """Angle between each rotation and the given one after removing the mean rotation, deg.

    A view that could not be placed counts as 180 deg.
    """
    known = [(p, t) for p, t in zip(placed, true, strict=True) if p is not None]
    between = Rotation.from_matrix(
        np.array([p.T_base_camera.rotation @ t.rotation.T for p, t in known])
    )
    off = np.degrees((between.mean().inv() * between).magnitude())
    return np.concatenate([off, np.full(len(placed) - len(known), LOST_DEG)])


def kitchen(seeds: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Both kinds of panorama; features from colour with either gradient, and from range alone."""
    views, poses = kitchen_views(say)
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
            placed, links = place(pictures, np.random.default_rng(seed), config)
            runs.append(rotation_errors_deg(placed, poses))
            say(f"{name}: {len(links)} pairs, rms {rms(runs[-1]):.2f} deg")
        figures[f"{name}_rms_deg"] = float(np.max([rms(run) for run in runs]))
        if name == "pan_range":
            share = float(np.mean(runs[0] < LOST_DEG))
            figures["pan_range_placed_share"] = share
            figures["pan_range_rms_deg"] = rms(runs[0][runs[0] < LOST_DEG])
        table.append(
            f"{name:<12} rms {figures[f'{name}_rms_deg']:.2f} deg"
            f"  worst view {max(float(run.max()) for run in runs):.2f} deg, {len(views)} views"
        )
    return figures, table


def run(seeds: int, say: Say) -> Outcome:
    """The kitchen, about two minutes, the worst of up to three runs; then sizes, ten seconds."""
    sizes = (object_sizes.cabinet, object_sizes.carton, object_sizes.furniture)
    return combined(kitchen(seeds, say), *(part(say) for part in sizes))


EXPERIMENT = Experiment(
    id="real-panorama",
    title="Real cameras: panoramas without encoders, and sizes of objects from single views",
    run=run,
    targets={
        "pan_rms_deg": Target("<=", 1.6),
        "pan_moving_rms_deg": Target("<=", 0.8),
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
