"""Floor segmentation by colour compared with floor segmentation by depth, in real recordings.

The colour model is initialised on a patch ahead of the camera in the first image and updated from there; the reference
is the set of points on the floor plane that the depth pipeline detects.

Source: ours; the ground image is that of Han 2018 (seed 000), section 3.1.
"""

from __future__ import annotations

import numpy as np

from ...offline.monocular import colour_floors
from ...recordings.open import open_recording
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Say, Target

SETS = {"cabinet": "tum_fr3_cabinet", "low_boxes": "realsense_low_boxes"}


def run(seeds: int, say: Say) -> Outcome:
    """Both sets; independent of the seeds."""
    figures: dict[str, float] = {}
    table = []
    for name, folder in SETS.items():
        found = []
        for floor in colour_floors(open_recording(real_data.folder(folder))):
            assert floor.iou is not None, "both sets have depth"
            found.append(floor.iou)
            say(f"{folder} frame {floor.number}: IoU {floor.iou:.3f}")
        figures[f"{name}_iou"] = float(np.mean(found))
        figures[f"{name}_iou_median"] = float(np.median(found))
        figures[f"{name}_iou_min"] = float(np.min(found))
        table.append(
            f"{folder:<20} {len(found):3d} frames  IoU mean {np.mean(found):.3f}  "
            f"median {np.median(found):.3f}  minimum {np.min(found):.3f}"
        )
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="real-ground",
    title="Floor by colour against floor by depth, in real recordings",
    run=run,
    targets={"cabinet_iou": Target(">=", 0.85), "low_boxes_iou": Target(">=", 0.75)},
    seeds=1,
)
