"""The moving picture of a run: camera and depth at the left, the growing map at the right, made from its estimates.

An animated WebP for a README or a message: it plays without a program. The map is what the terrain maps showed so far.
"""

from __future__ import annotations

import errno
import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from perception.primitives import safe_input
from perception.primitives.errors import InputError, OutputError
from perception.primitives.obstacle import MOVING
from perception.primitives.robot_model import RobotModel
from perception.primitives.safe_input import UnreadableError

from ..config.load import load
from ..results.moment import Moment
from ..results.moments import held, read_moments
from ..results.run_folder import RunFolder
from ..results.version import version
from ..words import count_of
from .film_map import INK, PAPER, Ground, draw_intention, draw_robot, draw_surfaces, draw_tracks

FILM = "film.webp"
FRAMES = 90  # ours: at 8 a second a loop of 11 s
FRAME_MS, LAST_MS = 125, 1500
QUALITY = 60  # of WebP
LARGEST_BYTES = 3_000_000
LEFT_PX, TEXT_PX = 300, 34  # width of the pictures, height of the line of text


def film(run: RunFolder, out: Path) -> Path:
    """Write the moving picture of a run as an animated WebP of at most 3 MB, and beside it what it shows, as JSON.

    Raises:
        InputError: The run has no pose to draw.
        RecordingError: The run has no estimates.
        OutputError: The file cannot be written.
    """
    moments = [one for one in held(read_moments(run)) if one.pose is not None]
    if len(moments) < 2:
        raise InputError(
            f"{run.root}: {count_of(len(moments), 'moment')} with a pose; a film needs a walk that is longer. "
            "Continue an interrupted run with `surefoot process --resume`"
        )
    moments = _pictured(moments)
    robot = load(run.path("config.toml")).robot_model if moments[-1].feet is not None else None
    frames = _frames(moments, robot)
    part = out.with_name(f".part-{out.stem}.webp")
    try:
        part.touch()  # OpenCV does not say why it cannot write
        while _write_animation(part, frames) > LARGEST_BYTES and len(frames) > 2:
            frames = [*frames[:-1:2], frames[-1]]
        os.replace(part, out)
        out.with_suffix(".json").write_text(json.dumps(_about(run, frames), indent=1) + "\n")
    except OSError as error:
        part.unlink(missing_ok=True)
        raise OutputError(f"cannot write {out}: {error.strerror}; choose another --out") from error
    return out


def _about(run: RunFolder, frames: Sequence[np.ndarray]) -> dict[str, Any]:
    """Version of the program, the run, and the size of the film."""
    summary = run.read_json("summary.json") or {}
    return {
        "version": version(),
        "run": summary.get("name"),
        "seconds": summary.get("seconds"),
        "frames": len(frames),
        "size_px": [frames[0].shape[1], frames[0].shape[0]],
    }


def _pictured(moments: list[Moment]) -> list[Moment]:
    """From the first moment on that has every kind of picture that any moment has; all if that leaves no two."""
    for number, one in enumerate(moments[:-1]):
        last = moments[-1]  # pictures are held: the last moment has all kinds
        if (one.colour is None) == (last.colour is None) and (one.depth is None) == (
            last.depth is None
        ):
            return moments[number:]
    return moments


def _write_animation(path: Path, frames: Sequence[np.ndarray]) -> int:
    """Write the pictures; the size of the file."""
    animation: Any = cv2.Animation()
    animation.frames = list(frames)
    animation.durations = np.array([FRAME_MS] * (len(frames) - 1) + [LAST_MS])
    if cv2.imwriteanimation(str(path), animation, [cv2.IMWRITE_WEBP_QUALITY, QUALITY]):
        with path.open("rb") as file:
            size = int.from_bytes(file.read(8)[4:], "little") + 8  # as its header says
        if path.stat().st_size >= size:
            return size
    path.write_bytes(bytes(LARGEST_BYTES))  # the system says why, OpenCV does not
    raise OSError(errno.EIO, "the picture cannot be encoded")


def _frames(
    moments: Sequence[Moment], robot: RobotModel | None
) -> list[UInt8[np.ndarray, "h w 3"]]:
    """Every n-th moment as a picture; the map collects what all of them saw."""
    ground, start_s = Ground(moments), moments[0].stamp_s
    chosen = set(np.unique(np.linspace(0, len(moments) - 1, FRAMES).round().astype(int)).tolist())
    path: list[np.ndarray] = []
    frames = []
    heights = [z for one in moments for s in one.surfaces or () for z in s.corners[:, 2].tolist()]
    span_m = (min(heights, default=0.0), max(heights, default=0.0))
    for number, moment in enumerate(moments):
        assert moment.pose is not None
        path.append(moment.pose.mean[:2])
        if moment.grid is not None:
            ground.add(moment.grid)
        if number in chosen:
            frames.append(_frame(moment, ground, np.array(path), robot, start_s, span_m))
    height = max(len(one) for one in frames)
    return [_padded(one, height) for one in frames]


def _frame(
    moment: Moment,
    ground: Ground,
    path: np.ndarray,
    robot: RobotModel | None,
    start_s: float,
    span_m: tuple[float, float],
) -> UInt8[np.ndarray, "h w 3"]:
    """One picture: camera over depth, the map beside them, and a line of text below."""
    left = _left(moment)
    world = ground.picture()
    draw_surfaces(world, ground, moment, span_m)
    draw_intention(world, ground, moment, robot)
    draw_tracks(world, ground, moment)
    draw_robot(world, ground, moment, path, robot)
    height = max(len(world), 0 if left is None else len(left))
    middle = _padded(world, height, (height - len(world)) // 2)
    parts = [middle] if left is None else [_padded(left, height), middle]
    whole = np.concatenate(parts, axis=1)
    text = np.full((TEXT_PX, whole.shape[1], 3), 255, np.uint8)
    _write(text, _words(moment, start_s), (10, 22), INK, 0.5)
    return np.concatenate([whole, text])


def _words(moment: Moment, start_s: float) -> str:
    assert moment.pose is not None
    sigma = np.sqrt(np.maximum(np.diag(moment.pose.covariance), 0.0))
    words = f"t {moment.stamp_s - start_s:5.1f} s    sigma {1e3 * math.hypot(*sigma[:2]):.0f} mm, {math.degrees(sigma[2]):.1f} deg"
    if moment.why:
        words += f"    {moment.why}"
    if moment.surfaces is not None:  # a walk over several levels tracks nothing
        return words
    moving = sum(one.moving >= MOVING for one in moment.tracks)
    return words + f"    obstacles tracked: {len(moment.tracks)}, moving: {moving}"


def _left(moment: Moment) -> np.ndarray | None:
    pictures = [one for one in (_camera(moment), _depth(moment)) if one is not None]
    return np.concatenate(pictures) if pictures else None


def _camera(moment: Moment) -> np.ndarray | None:
    if moment.colour is None:
        return None
    try:
        picture = safe_input.picture(moment.colour, cv2.IMREAD_COLOR)
    except UnreadableError:
        return None
    return _fitted(picture, "camera")


def _depth(moment: Moment) -> np.ndarray | None:
    """Near is bright; black where there is none."""
    if moment.depth is None:
        return None
    depth = moment.depth.astype(np.float32)
    level = np.clip(1.15 - depth / max(float(depth.max()), 1.0), 0.0, 1.0)
    picture = cv2.applyColorMap((255 * level).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    picture[moment.depth == 0] = 0
    named = "depth" if moment.depth_sensor in ("", "depth") else f"depth ({moment.depth_sensor})"
    return _fitted(np.asarray(picture), named)


def _fitted(picture: np.ndarray, name: str) -> np.ndarray:
    size = (LEFT_PX, round(picture.shape[0] * LEFT_PX / picture.shape[1]))
    fitted = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    label = fitted[:26, : 18 + 7 * len(name)]
    label[...] = label // 3
    _write(fitted, name, (8, 18), (255, 255, 255), 0.45)
    return fitted


def _padded(picture: np.ndarray, height: int, above: int = 0) -> np.ndarray:
    """With paper above and below."""
    whole = np.full((height, picture.shape[1], 3), PAPER, np.uint8)
    whole[above : above + len(picture)] = picture
    return whole


def _write(
    picture: np.ndarray,
    words: str,
    place: tuple[int, int],
    colour: tuple[int, int, int],
    size: float,
) -> None:
    cv2.putText(picture, words, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
