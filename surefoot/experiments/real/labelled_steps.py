"""The labelled staircase of the time-of-flight set DPD: overlap of plane regions with its treads and risers.

The image has grey levels without units, brighter where nearer, close to linear in inverse depth; so a plane is a plane in any
unit. It is not rectified, and no calibration comes with it: the lens is the one by which the nosings of the five upper
steps, found where grey passes the middle between two risers, are straight lines. Five of its planes are numbered by the
data set; all five are risers, as their grey level does not change downwards. Its treads are the strips of some rows between
them. Labels are used for scoring only; pixels without one are not scored. The lens and the size of the noise were chosen on
this image, the only labelled one with stairs.

Source: ours; data set DPD planes (Jin et al. 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Int

from perception.depth.distortion import Distortion, DistortionConfig
from perception.depth.reach import ReachConfig
from perception.floor.choose import FloorConfig
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth
from perception.terrain import segmentation

from ..support import real_data
from ..support.experiment import Part, Say
from .labelled_floors import SR4000, as_depth

NAME = "sr4000_scene4"
TREADS = (110, 198)  # grey levels of the label image; a third one ends at the border of the image
RISERS = (122, 123, 155, 137, 200, 201)
UNLABELLED = (0, 255)
NOISE_GREY = 1.5  # ours: levels are whole numbers, and stray light rounds the foot of a riser
LENS = (-0.59, 0.0, 0.0, 0.0, 0.0)
"""Ours: k1; the nosings are straight within .2 to .4 pixels, .2 to 1.1 without it."""
WHOLE = ReachConfig(0.01, 100.0)
NO_UNITS = FloorConfig(distortion=DistortionConfig(tof=Distortion()))


def images() -> tuple[Depth, Int[np.ndarray, "h w"]]:
    """Depth up to scale, and the labels.

    Raises:
        InputError: The recording is absent.
    """
    folder = real_data.folder("dpd_planes")
    grey, labels = (real_data.grey(folder / f"{NAME}{end}.png") for end in ("", "_gt"))
    kind = replace(SR4000, camera=replace(SR4000.camera, distortion=LENS))
    depth = as_depth(grey.astype(np.float64), kind.curves[0], kind, NOISE_GREY)
    return depth, labels.astype(np.int64)


def overlaps(
    masks: Sequence[Bool[np.ndarray, "h w"]], labels: Int[np.ndarray, "h w"], wanted: Sequence[int]
) -> list[float]:
    """Intersection over union of each wanted label with the region that overlaps it most, over labelled pixels."""
    known = ~np.isin(labels, UNLABELLED)
    found = []
    for label in wanted:
        true = labels == label
        shares = [
            float((mask & true).sum() / max(((mask & known) | true).sum(), 1)) for mask in masks
        ]
        found.append(max(shares, default=0.0))
    return found


def scores(say: Say) -> Part:
    """Overlap of the treads and the risers; absent recordings are told, not scored."""
    try:
        depth, labels = images()
    except InputError as error:
        say(str(error))
        return {}, [f"labelled staircase: not measured, {error}"]
    regions = segmentation.find(depth, WHOLE, NO_UNITS, "tof")
    masks = [one.mask(depth.camera) for one in regions]
    treads, risers = overlaps(masks, labels, TREADS), overlaps(masks, labels, RISERS)
    say(f"labelled staircase: {len(regions)} regions")
    words = [" ".join(f"{value:.2f}" for value in values) for values in (treads, risers)]
    figures = {"tread_iou": min(treads), "riser_iou": min(risers)}
    return figures, [f"labelled staircase (time of flight)  treads {words[0]}; risers {words[1]}"]
