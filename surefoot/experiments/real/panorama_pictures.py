"""How many views of a hand-held camera the pictures alone place, and whether any is placed wrongly.

The sets are both parts of the kitchen of 7-Scenes, as recorded and spoilt: without colour, or with motion blur, and with
holes in 40 % of each depth image; fewer views, so that neighbours share less. The camera round the cabinet does not stay
at a place, the cabinet looks the same from opposite sides, and the floor is bare: its views need not be placed, but none
may be placed wrongly.

How many views in a row may be skipped was chosen on the cabinet; the other bounds are those of odometry and loop
closures. The kitchen is reported. Its given poses jump by 1.8 deg within the sweep.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8
from scipy.spatial.transform import Rotation

from mapping.panorama.adjustment import Placed
from mapping.panorama.stitching import StitchConfig, place
from mapping.panorama.views import View, view_of_depth
from perception.depth import structured_light
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3

from ...offline.panorama_views import FARTHEST_M
from ...recordings.open import open_recording
from ..support import real_data
from ..support.experiment import Say

WRONG_DEG = 5.0  # a view this far off is placed wrongly
HOLES = 0.4  # share of each depth image that is lost
BLOB_PX = 40  # size of the holes
BLUR_PX = (5, 25)  # length of the motion blur
LOST_DEG = 180.0  # error of a view that was not placed


class Shot(NamedTuple):
    """One frame of a recording, and its given pose."""

    depth: Depth
    grey: UInt8[np.ndarray, "h w"]
    pose: Pose3


Spoil = Callable[[Shot, np.random.Generator], tuple[Depth, UInt8[np.ndarray, "h w"] | None]]


class Case(NamedTuple):
    """A set of views: every `every`-th frame of a recording, spoilt in a way."""

    recording: str
    every: int
    spoil: Spoil
    to_place: bool = True


def as_recorded(shot: Shot, rng: np.random.Generator) -> tuple[Depth, np.ndarray | None]:
    """The images as they are."""
    return shot.depth, shot.grey


def blind_with_holes(shot: Shot, rng: np.random.Generator) -> tuple[Depth, np.ndarray | None]:
    """No colour, and holes in the depth image."""
    return _with_holes(shot.depth, rng), None


def blurred_with_holes(shot: Shot, rng: np.random.Generator) -> tuple[Depth, np.ndarray | None]:
    """Motion blur in any direction, and holes in the depth image."""
    length, angle = int(rng.integers(*BLUR_PX)), float(rng.uniform(0.0, np.pi))
    along = np.linspace(-0.5, 0.5, 4 * length) * (length - 1)
    kernel = np.zeros((length, length), np.float32)
    middle = (length - 1) / 2
    rows, columns = np.rint(middle + along * np.sin(angle)), np.rint(middle + along * np.cos(angle))
    kernel[rows.astype(int), columns.astype(int)] = 1.0
    blurred = cv2.filter2D(shot.grey, -1, kernel / kernel.sum())
    return _with_holes(shot.depth, rng), np.asarray(blurred, np.uint8)


KITCHEN, CABINET = "sevenscenes_redkitchen", "tum_fr3_cabinet"
CASES = {
    "pan": Case(f"{KITCHEN}/pan", 1, as_recorded),
    "sweep": Case(f"{KITCHEN}/sweep", 2, as_recorded),
    "pan, no colour, holes": Case(f"{KITCHEN}/pan", 4, blind_with_holes),
    "pan, blurred, holes": Case(f"{KITCHEN}/pan", 4, blurred_with_holes),
    "sweep, no colour, holes": Case(f"{KITCHEN}/sweep", 4, blind_with_holes),
    "sweep, blurred, holes": Case(f"{KITCHEN}/sweep", 4, blurred_with_holes),
    "round the cabinet": Case(CABINET, 2, as_recorded, to_place=False),
    "round the cabinet, sparse": Case(CABINET, 4, as_recorded, to_place=False),
}


def run(say: Say) -> tuple[dict[str, float], list[str]]:
    """All cases, two minutes."""
    shares, worst, wrong, table = [], 0.0, 0, []
    for name, case in CASES.items():
        taken, rng = shots(case.recording, case.every), np.random.default_rng(0)
        views = [_view(shot, case.spoil, rng) for shot in taken]
        placed, _, _ = place(views, np.random.default_rng(1), StitchConfig(moving=True))
        errors = rotation_errors_deg(placed, [shot.pose for shot in taken])
        found = errors[errors < LOST_DEG]
        wrong += int(np.sum(found > WRONG_DEG))
        if case.to_place:
            shares.append(len(found) / len(views))
            worst = max(worst, float(found.max()))
        by = [one.by for one in placed if one is not None]
        kinds = ", ".join(f"{by.count(kind)} by {kind}" for kind in sorted(set(by)))
        table.append(
            f"{name:<26} {len(found)} of {len(views)} views placed ({kinds}), worst {found.max():.2f} deg"
        )
        say(table[-1])
    figures = {
        "placed_share_min": min(shares),
        "placed_worst_deg": worst,
        "wrongly_placed": float(wrong),
    }
    return figures, table


def rotation_errors_deg(placed: list[Placed | None], true: list[Pose3]) -> np.ndarray:
    """Angle between each rotation and the given one after removing the mean rotation, deg.

    A view that could not be placed counts as 180 deg, at the end.
    """
    known = [(p, t) for p, t in zip(placed, true, strict=True) if p is not None]
    between = Rotation.from_matrix(
        np.array([p.T_base_camera.rotation @ t.rotation.T for p, t in known])
    )
    off = np.degrees((between.mean().inv() * between).magnitude())
    return np.concatenate([off, np.full(len(placed) - len(known), LOST_DEG)])


def shots(recording: str, every: int = 1) -> list[Shot]:
    """Depth, grey picture and given pose of every `every`-th frame."""
    found = []
    for number, frame in enumerate(open_recording(real_data.folder(recording)).frames()):
        if number % every:
            continue
        assert frame.depth is not None, "the recording has depth in every frame"
        assert frame.colour is not None, "the recording has colour in every frame"
        assert frame.T_world_camera is not None, "the recording gives every pose"
        grey = cv2.cvtColor(frame.colour.rgb, cv2.COLOR_RGB2GRAY).astype(np.uint8)
        found.append(Shot(structured_light.depth(frame.depth), grey, frame.T_world_camera))
    return found


def _view(shot: Shot, spoil: Spoil, rng: np.random.Generator) -> View:
    depth, grey = spoil(shot, rng)
    return view_of_depth(depth, FARTHEST_M, grey)


def _with_holes(depth: Depth, rng: np.random.Generator) -> Depth:
    height, width = depth.z.shape
    coarse = rng.standard_normal((height // BLOB_PX, width // BLOB_PX)).astype(np.float32)
    relief = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    lost = relief < np.quantile(relief, HOLES)
    return replace(depth, z=np.where(lost, np.float32(np.nan), depth.z))
