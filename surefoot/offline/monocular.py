"""The monocular cycle on a recording, and the picture of its eight stages.

A recording gives colour pictures; `colour_eye` tells where the camera stood above the floor. Where a depth image is
registered to the picture, the floor in it is what the colour floor is judged by.

Source: seed 000, Fig. 8.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool

from perception.estimate import Estimate
from perception.monocular.cycle import Monocular
from perception.monocular.result import MonocularResult, Picture
from perception.primitives.errors import InputError, RecordingError
from perception.primitives.frame import DepthView, Frame
from perception.primitives.plane import Plane

from ..config.schema import Config
from ..recordings.recording import FrameError, Recording, SkipLog
from ..report.plots.monocular import stages
from ..run.pipeline import Pipeline
from .colour_camera_pose import T_floor_colour, registered

NEAR_FLOOR_M = 0.015  # a depth point so near the plane is floor
NEAR_FLOOR_SHARE = 0.01  # and the same again for every square metre of its depth squared
ODD = "its picture or its pose cannot be used"

Say = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class ColourFloor:
    """One frame of a recording.

    Args:
        number: Of the frame, from 0.
        result: The cycle.
        depth_floor: Where the depth camera sees the floor; None where no depth is registered to the colours.
        depth_known: Where it sees anything; None likewise.
    """

    number: int
    result: MonocularResult
    depth_floor: Bool[np.ndarray, "h w"] | None = None
    depth_known: Bool[np.ndarray, "h w"] | None = None

    @property
    def iou(self) -> float | None:
        """Of the colour floor and the depth floor, over the pixels with depth; None without depth."""
        if self.depth_floor is None or self.depth_known is None:
            return None
        colour = self.result.ground > 0
        both = np.count_nonzero(colour & self.depth_floor)
        either = np.count_nonzero((colour | self.depth_floor) & self.depth_known)
        return both / either if either else 1.0


def colour_floors(
    recording: Recording,
    config: Config | None = None,
    journal: SkipLog | None = None,
    say: Say = lambda text: None,
) -> Iterator[ColourFloor]:
    """Every frame with a colour picture over a floor; the pair is this picture and the one before.

    Where nobody knows how the camera moved there is no pair: what moved, camera or obstacle, cannot be told.

    Args:
        recording: Of any kind.
        config: Of pipeline and cycle.
        journal: Gets the frames that cannot be used, and why.
        say: Gets what is wrong with an odd picture, in detail.
    """
    config = config or Config()
    journal = journal or SkipLog()
    monocular, pipeline = Monocular(config.monocular), Pipeline(config, recording.info)
    before: Picture | None = None
    for number, frame in enumerate(recording.frames()):
        name = f"frame {number}"
        try:
            _check_pose(frame)
            estimate = pipeline.cycle(_without_odd_colour(frame)).estimate
            picture = _picture(frame, estimate, recording)
            if before is not None and before.camera != picture.camera:
                before = None
            result = monocular.cycle(before, picture)
        except FrameError as error:
            journal.skip(name, str(error))
            if frame.colour is not None:
                before = None
            continue
        except InputError as error:
            say(f"{name}: {error}")
            journal.skip(name, ODD)
            before = None
            continue
        before = picture if estimate.pose is not None else None
        yield ColourFloor(number, result, *_judge(frame, estimate))


def _check_pose(frame: Frame) -> None:
    """Refuse a given pose that is not a number, before the pipeline takes it."""
    pose = frame.T_world_camera
    if pose is not None and not np.isfinite([*pose.translation, *pose.quat_xyzw]).all():
        raise FrameError(ODD)


def _without_odd_colour(frame: Frame) -> Frame:
    """The frame for the pipeline: footsteps and depth count also if the picture is not its camera's."""
    colour = frame.colour
    if colour is None or colour.rgb.shape == (colour.camera.height, colour.camera.width, 3):
        return frame
    return replace(frame, colour=None)


def _picture(frame: Frame, estimate: Estimate, recording: Recording) -> Picture:
    pose = T_floor_colour(frame, estimate, recording.info)
    assert frame.colour is not None, "there is no place without a picture"
    return Picture(frame.colour.rgb, frame.colour.camera, pose, frame.stamp_s)


def _judge(frame: Frame, estimate: Estimate) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Where depth registered to the picture shows floor, and where anything; None twice without it."""
    depth = frame.depth
    if depth is None or frame.colour is None or not registered(depth, frame.colour):
        return None, None
    for view in estimate.views:
        if view.sensor == "depth":
            return depth_floor(depth, view.floor), np.isfinite(depth.depth)
    return None, None


def depth_floor(view: DepthView, plane: Plane) -> Bool[np.ndarray, "h w"]:
    """Pixels whose point lies on the plane (camera frame), within the noise of a depth camera."""
    x, y = view.camera.slopes
    z = view.depth
    n = plane.normal
    with np.errstate(invalid="ignore"):
        off = np.abs(z * (n[0] * x + n[1] * y + n[2]) + plane.offset_m)
        return np.asarray(off < NEAR_FLOOR_M + NEAR_FLOOR_SHARE * z * z)


def process_monocular(
    recording: Recording, folder: Path, say: Say, config: Config | None = None
) -> dict[str, Any]:
    """Run the monocular cycle over a recording; one picture of stages a frame, and `monocular.json`.

    Returns:
        `frames`, how many `skipped` by reason, how many were `judged` by depth, and if any were, median and least of
        `iou`.

    Raises:
        RecordingError: Not a single frame could be used.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in (*folder.glob("stages-*.png"), folder / "monocular.json"):
        old.unlink(missing_ok=True)
    journal, judged, frames = SkipLog(), [], 0
    for floor in colour_floors(recording, config, journal, say):
        frames += 1
        name = folder / f"stages-{floor.number:06d}.png"
        cv2.imwrite(str(name), cv2.cvtColor(stages(floor.result), cv2.COLOR_RGB2BGR))
        told = f"frame {floor.number}: {len(floor.result.obstacles)} obstacles"
        if floor.iou is not None:
            judged.append(floor.iou)
            told += f", IoU {floor.iou:.3f}"
        say(told)
    reasons = [one.reason for one in (*recording.skipped, *journal.skipped)]
    skipped = {reason: reasons.count(reason) for reason in sorted(set(reasons))}
    if not frames:
        why = "; ".join(f"{count}: {reason}" for reason, count in skipped.items()) or "it is empty"
        raise RecordingError(
            f"{recording.info.name}: none of its frames could be used ({why}); "
            "give a recording with colour pictures and a floor, or poses, or footsteps"
        )
    summary: dict[str, Any] = {"frames": frames, "skipped": skipped, "judged": len(judged)}
    if judged:
        summary |= {"iou": float(np.median(judged)), "iou_min": float(np.min(judged))}
    (folder / "monocular.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return summary
