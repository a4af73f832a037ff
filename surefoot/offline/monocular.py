"""The monocular cycle on a recording: floor and obstacles by colour alone, and a picture of its eight stages.

`colour_camera_pose` gives the pose of the colour camera over the floor. Where a depth image is registered to the
picture, the floor in it is the reference for the floor by colour.

Source: seed 000, Fig. 8.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool

from perception.depth.sources import registered
from perception.estimate import Estimate
from perception.monocular.cycle import Monocular
from perception.monocular.result import MonocularResult, Picture
from perception.primitives.errors import InputError, OutputError, RecordingError
from perception.primitives.frame import DepthView, Frame
from perception.primitives.plane import Plane

from ..config.schema import Config
from ..progress import Say, silent
from ..recordings.recording import FrameError, Recording, SkipLog
from ..report.plots.monocular import stages
from ..run.pipeline import Pipeline
from .camera_moments import CameraMoments
from .colour_camera_pose import T_floor_colour
from .job import Job, count_reasons

NEAR_FLOOR_M = 0.015  # ours: a depth point this near to the plane is floor, ...
NEAR_FLOOR_PER_M = 0.01  # ours: ... and farther by this times depth squared
UNUSABLE = "its picture or its pose cannot be used"


@dataclass(frozen=True, eq=False)
class ColourFloor:
    """The floor by colour in one frame of a recording.

    Args:
        number: Number of the frame, from 0.
        result: Result of the monocular cycle.
        picture: The picture with its camera pose.
        depth_floor: Pixels where the depth camera sees the floor; None without depth registered to the picture.
        depth_known: Pixels with depth; None likewise.
    """

    number: int
    result: MonocularResult
    picture: Picture
    depth_floor: Bool[np.ndarray, "h w"] | None = None
    depth_known: Bool[np.ndarray, "h w"] | None = None

    @property
    def iou(self) -> float | None:
        """Intersection over union of the floors by colour and by depth, over the pixels with depth."""
        if self.depth_floor is None or self.depth_known is None:
            return None
        colour = self.result.ground > 0
        both = np.count_nonzero(colour & self.depth_floor)
        either = np.count_nonzero((colour | self.depth_floor) & self.depth_known)
        return both / either if either else 1.0


def colour_floors(
    recording: Recording,
    config: Config | None = None,
    skips: SkipLog | None = None,
    say: Say = silent,
) -> Iterator[ColourFloor]:
    """The floor by colour of every frame with a picture; the cycle also gets the picture before it.

    There is no earlier picture if the motion of the camera between both is unknown.

    Args:
        recording: A recording of any kind.
        config: Settings of pipeline and cycle.
        skips: Receives the frames that cannot be used, with reasons.
        say: Receives details about unusable frames.
    """
    config = config or Config()
    skips = skips or SkipLog()
    monocular, pipeline = Monocular(config.monocular), Pipeline(config, recording.info)
    before: Picture | None = None
    for number, frame in enumerate(recording.frames()):
        name = f"frame {number}"
        try:
            _check_pose(frame)
            estimate = pipeline.cycle(_without_unusable_colour(frame)).estimate
            picture = _picture(frame, estimate, recording)
            if before is not None and before.camera != picture.camera:
                before = None
            result = monocular.cycle(before, picture)
        except FrameError as error:
            skips.skip(name, str(error))
            if frame.colour is not None:
                before = None
            continue
        except InputError as error:
            say(f"{name}: {error}")
            skips.skip(name, UNUSABLE)
            before = None
            continue
        before = picture if estimate.pose is not None else None
        yield ColourFloor(number, result, picture, *_reference(frame, estimate))


def _check_pose(frame: Frame) -> None:
    """Refuse a given pose that is not finite, before the pipeline takes it."""
    pose = frame.T_world_camera
    if pose is not None and not np.isfinite([*pose.translation, *pose.quat_xyzw]).all():
        raise FrameError(UNUSABLE)


def _without_unusable_colour(frame: Frame) -> Frame:
    """The frame for the pipeline, which uses footsteps and depth even if the picture does not fit its camera."""
    colour = frame.colour
    if colour is None or colour.rgb.shape == (colour.camera.height, colour.camera.width, 3):
        return frame
    return replace(frame, colour=None)


def _picture(frame: Frame, estimate: Estimate, recording: Recording) -> Picture:
    pose = T_floor_colour(frame, estimate, recording.info)
    assert frame.colour is not None, "a frame without a picture has no pose of it"
    return Picture(frame.colour.rgb, frame.colour.camera, pose, frame.stamp_s)


def _reference(frame: Frame, estimate: Estimate) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Pixels with floor and pixels with depth; None twice without depth registered to the picture."""
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
        return np.asarray(off < NEAR_FLOOR_M + NEAR_FLOOR_PER_M * z * z)


def run_monocular(job: Job, say: Say) -> dict[str, Any]:
    """Run the monocular cycle over a recording; writes a picture of the stages of every frame and `monocular.json`.

    Args:
        job: The recording, with colour pictures, and the output folder.
        say: Progress.

    Returns:
        The content of `monocular.json`: number of `frames`, `skipped` frames by reason, how many frames were
        compared with depth (`judged`), and the median and least `iou` of those.

    Raises:
        RecordingError: No frame could be used.
        OutputError: The folder cannot be written.
    """
    recording, skips, frames = job.recording, SkipLog(), 0
    moments = CameraMoments(job.folder, job.config, every_s=0.0)
    ious: list[float] = []
    for floor in colour_floors(recording, job.config, skips, say):
        frames += 1
        file = f"stages-{floor.number:06d}.png"
        done, png = cv2.imencode(".png", cv2.cvtColor(stages(floor.result), cv2.COLOR_RGB2BGR))
        if not done:
            raise OutputError(f"{job.folder.path(file)}: the picture could not be encoded")
        job.folder.write_bytes(file, png.tobytes())
        shown = floor.picture
        moments.add(shown.stamp_s, "colour", shown.camera, shown.T_world_camera, rgb=shown.rgb)
        text = f"frame {floor.number}: {len(floor.result.obstacles)} obstacles"
        if floor.iou is not None:
            ious.append(floor.iou)
            text += f", IoU {floor.iou:.3f}"
        say(text)
    moments.close()
    skipped = count_reasons([one.reason for one in (*recording.skipped, *skips.skipped)])
    if not frames:
        why = "; ".join(f"{count}: {reason}" for reason, count in skipped.items()) or "it is empty"
        raise RecordingError(
            f"{recording.info.name}: none of its frames could be used ({why}); "
            "give a recording with colour pictures and a floor, or poses, or footsteps"
        )
    figures: dict[str, Any] = {"judged": len(ious)}
    if ious:
        figures |= {"iou": float(np.median(ious)), "iou_min": float(np.min(ious))}
    content: dict[str, Any] = {"frames": frames, "skipped": skipped, **figures}
    job.folder.write_json("monocular.json", content)
    job.finish(frames, skipped, **figures)
    return content
