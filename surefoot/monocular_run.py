"""The monocular cycle on a recording, and the picture of its eight stages.

A recording gives colour pictures; where the camera stood above the floor comes from its given poses, or,
where there are none, from the floor that the depth camera sees. The depth floor is also what the colour floor
is judged by.

Source: seed 000, Fig. 8.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from perception.monocular.cycle import Monocular, MonocularConfig
from perception.monocular.result import MonocularResult, Picture
from perception.primitives.frame import DepthView, Frame
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3

from .config import Config
from .pipeline import Pipeline
from .recordings.recording import Recording

NEAR_FLOOR_M = 0.015  # a depth point so near the plane is floor
NEAR_FLOOR_SHARE = 0.01  # and the same again for every square metre of its depth squared


@dataclass(frozen=True, eq=False)
class ColourFloor:
    """One frame of a recording.

    Args:
        number: Of the frame, from 0.
        result: The cycle.
        depth_floor: Where the depth camera sees the floor.
        depth_known: Where it sees anything.
    """

    number: int
    result: MonocularResult
    depth_floor: Bool[np.ndarray, "h w"]
    depth_known: Bool[np.ndarray, "h w"]

    @property
    def iou(self) -> float:
        """Of the colour floor and the depth floor, over the pixels with depth."""
        colour = self.result.ground > 0
        both = np.count_nonzero(colour & self.depth_floor)
        either = np.count_nonzero((colour | self.depth_floor) & self.depth_known)
        return both / either if either else 1.0


def colour_floors(
    recording: Recording, config: MonocularConfig | None = None
) -> Iterator[ColourFloor]:
    """Every frame of a recording with colour, depth and a floor; the pair is this frame and the one before.

    Without given poses there is no pair: what moved, camera or obstacle, cannot be told.
    """
    monocular = Monocular(config or MonocularConfig())
    pipeline = Pipeline(Config(), recording.info)
    before: Picture | None = None
    for number, frame in enumerate(recording.frames()):
        estimate = pipeline.cycle(frame)
        if frame.colour is None or frame.depth is None or not estimate.views:
            continue
        plane = estimate.views[0].floor
        picture = Picture(
            frame.colour.rgb, frame.colour.camera, _above_floor(frame, plane), frame.stamp_s
        )
        result = monocular.cycle(before, picture)
        if frame.T_world_camera is not None:
            before = picture
        known = np.isfinite(frame.depth.depth)
        yield ColourFloor(number, result, depth_floor(frame.depth, plane), known)


def depth_floor(view: DepthView, plane: Plane) -> Bool[np.ndarray, "h w"]:
    """Pixels whose point lies on the plane (camera frame), within the noise of a depth camera."""
    x, y = view.camera.slopes
    z = view.depth
    n = plane.normal
    with np.errstate(invalid="ignore"):
        off = np.abs(z * (n[0] * x + n[1] * y + n[2]) + plane.offset_m)
        return np.asarray(off < NEAR_FLOOR_M + NEAR_FLOOR_SHARE * z * z)


def process_monocular(
    recording: Recording,
    folder: Path,
    say: Callable[[str], None],
    config: MonocularConfig | None = None,
) -> dict[str, float]:
    """Run the monocular cycle over a recording; one picture of stages a frame, and `monocular.json`.

    Returns:
        `frames`, and median and least of `iou`; only `frames` if there was none.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for floor in colour_floors(recording, config):
        found.append(floor.iou)
        name = folder / f"stages-{floor.number:06d}.png"
        cv2.imwrite(str(name), cv2.cvtColor(stages(floor.result), cv2.COLOR_RGB2BGR))
        say(f"frame {floor.number}: {len(floor.result.obstacles)} obstacles, IoU {floor.iou:.3f}")
    summary: dict[str, float] = {"frames": float(len(found))}
    if found:
        summary |= {"iou": float(np.median(found)), "iou_min": float(np.min(found))}
    (folder / "monocular.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return summary


def stages(result: MonocularResult, side_px: int = 360) -> UInt8[np.ndarray, "h w 3"]:
    """The eight pictures of a cycle as one: A, B the pair, C ground, D edges, E flow, F least flow,
    G prediction, H result.
    """
    current = result.current.rgb
    previous = current if result.previous is None else result.previous.rgb
    faint = (0.5 * current + 110).astype(np.uint8)
    flows, least, predicted = faint.copy(), faint.copy(), current.copy()
    chosen = {o.flow for o in result.obstacles if o.flow >= 0}
    for k in range(len(result.flows)):
        begin, end = (
            tuple(np.rint(p[k]).astype(int).tolist())
            for p in (result.flows.previous, result.flows.current)
        )
        colour = (200, 0, 0) if result.flows.obstacle[k] >= 0 else (120, 120, 120)
        cv2.arrowedLine(flows, begin, end, colour, 2, tipLength=0.3)
        if k in chosen:
            cv2.arrowedLine(least, begin, end, (200, 0, 0), 3, tipLength=0.3)
    predicted[result.predicted > 0] = (230, 40, 40)
    for obstacle in result.obstacles:
        colour = (230, 40, 40) if obstacle.moving else (30, 60, 220)
        for image in (least, predicted):
            cv2.polylines(image, [obstacle.edge.astype(np.int32)], False, colour, 2)
    grey = [
        cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
        for image in (
            result.ground,
            np.asarray(cv2.dilate(result.edges, np.ones((3, 3), np.uint8))),
            result.movable,
        )
    ]
    panes = (
        ("A previous", previous),
        ("B current", current),
        ("C ground", grey[0]),
        ("D edges", grey[1]),
        ("E optical flow", flows),
        ("F least flow", least),
        ("G prediction", predicted),
        ("H result", grey[2]),
    )
    shown = []
    for title, image in panes:
        pane = cv2.resize(image, (side_px, side_px * image.shape[0] // image.shape[1]))
        cv2.rectangle(pane, (0, 0), (side_px // 2, 24), (255, 255, 255), -1)
        cv2.putText(pane, title, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (0, 0, 0), 1, cv2.LINE_AA)
        shown.append(cv2.copyMakeBorder(pane, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(90, 90, 90)))
    return np.asarray(np.vstack([np.hstack(shown[:4]), np.hstack(shown[4:])]), dtype=np.uint8)


def _above_floor(frame: Frame, plane: Plane) -> Pose3:
    """The camera in a world whose floor is z = 0: tilt and height by the plane, the rest as it is given.

    The given pose keeps heading and place on the floor; the plane in the camera's own frame keeps the floor
    where it is seen, whatever world the recording uses.
    """
    up = plane.normal
    if frame.T_world_camera is None:
        ahead, place = np.array([0.0, 0.0, 1.0]), np.zeros(2)
    else:
        ahead = frame.T_world_camera.rotation[0]  # world x in camera axes
        place = frame.T_world_camera.position[:2]
    x = ahead - up * float(ahead @ up)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(up, x), up])
    return Pose3.from_rotation(rotation, np.array([*place, plane.offset_m]))
