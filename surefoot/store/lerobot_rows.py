"""The rows of a run for a dataset: its states, actions, estimates with covariances, and pictures, at a constant rate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perception.primitives.errors import InputError, SurefootError
from perception.primitives.frame import Frame

from ..progress import Say
from ..recordings.open import open_recording
from ..results.run_folder import RECORDING, RunFolder
from .schema import PLANE, POSE, STATE

JPEG_QUALITY = 95
OBSTACLES = 8  # ours: nearest tracks of a row
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
COLOUR, DEPTH = "observation.images.colour", "observation.depth"
OBSTACLE = ("present", "x_m", "y_m", "vx_mps", "vy_mps", *STATE, "radius_m", "height_m", "moving")
POSE_NAMES = ("x_m", "y_m", "z_m", "yaw_rad")
STEP_NAMES, HEAD_NAMES = ("forward_m", "lateral_m", "turn_rad"), ("pan_rad", "tilt_rad")
MOST_FPS = 120
MOST_REPEATS = 100  # ours: rows per frame of a run with gaps
ALWAYS = 200_000  # ours: as many rows are written however few frames there are
SAME_DIGITS = 6  # of a stamp, s


@dataclass
class Episode:
    """The rows of a run.

    Args:
        task: What the robot does, in words.
        vectors: Feature to (rows, values), float32.
        names: Feature to the names of its values.
        stamps: (rows,), s.
        pictures: Feature to its encoded pictures.
        shapes: Feature with pictures to (height, width, channels).
        stats: Statistics of the pictures.
    """

    task: str
    vectors: dict[str, np.ndarray]
    names: dict[str, tuple[str, ...]]
    stamps: np.ndarray
    pictures: dict[str, list[bytes]]
    shapes: dict[str, tuple[int, int, int]]
    stats: dict[str, dict[str, Any]]


def episode_of(run: RunFolder, columns: Mapping[str, Any], fps: int, say: Say) -> Episode:
    """The rows of a run at a constant rate.

    Raises:
        InputError: The run has no poses, or nearly no frames for its duration.
    """
    frames = columns.get("frames")
    if frames is None or not np.isfinite(frames["x_m"]).any():
        raise InputError(f"{run.root}: the run has no poses; a dataset needs them")
    placed = np.flatnonzero(np.isfinite(frames["x_m"]))
    stamps = frames["stamp_s"][placed]
    count = 1 + math.floor((stamps[-1] - stamps[0]) * fps + 0.5)
    if count > max(ALWAYS, MOST_REPEATS * len(stamps)):
        raise InputError(
            f"{run.root}: {len(stamps)} frames in {stamps[-1] - stamps[0]:.6g} s would be {count} rows at {fps} per "
            "second; the clock was set during the recording: correct its stamps and process it again"
        )
    clock = stamps[0] + np.arange(count) / fps
    nearest = _nearest(stamps, clock)
    frame = {
        name: np.asarray(frames[name])[placed][nearest] for name in ("stamp_s", *POSE_NAMES, *POSE)
    }
    vectors = {
        "observation.state": _stack(frame, POSE_NAMES),
        "observation.pose_covariance": _stack(frame, POSE),
    }
    names: dict[str, tuple[str, ...]] = {
        "observation.state": POSE_NAMES,
        "observation.pose_covariance": POSE,
    }
    decided = columns.get("steps")
    if decided is not None:
        held = _held(decided["stamp_s"], frame["stamp_s"])
        steps = np.where(held[:, None] < 0, 0.0, _stack(decided, STEP_NAMES)[held])
        head = np.where(held[:, None] < 0, 0.0, _stack(columns["decisions"], HEAD_NAMES)[held])
        vectors["action"] = np.hstack([steps, head])
        names["action"] = (*STEP_NAMES, *HEAD_NAMES)
    else:
        vectors["action"], names["action"] = _motion(frame), STEP_NAMES
    for camera, plane in _floors(columns.get("floors"), frame["stamp_s"]).items():
        vectors[f"observation.floor.{camera}"] = plane
        names[f"observation.floor.{camera}"] = ("nx", "ny", "nz", "height_m", *PLANE, "share")
    vectors["observation.obstacles"] = _obstacles(columns.get("tracks"), frame)
    names["observation.obstacles"] = tuple(
        f"{name}_{k}" for k in range(OBSTACLES) for name in OBSTACLE
    )
    summary = run.read_json("summary.json") or {}
    episode = Episode(
        f"walk through {summary.get('name') or run.root.name}"
        if decided is not None
        else "move the camera",
        {name: np.nan_to_num(value).astype(np.float32) for name, value in vectors.items()},
        names,
        frame["stamp_s"],
        {},
        {},
        {},
    )
    _add_pictures(episode, run, summary, say)
    return episode


def rate_of(run: RunFolder, columns: Mapping[str, Any]) -> int:
    """Frames per second of a run, a whole number.

    Raises:
        InputError: It has fewer than two frames.
    """
    frames = columns.get("frames")
    gaps = np.diff(frames["stamp_s"]) if frames is not None else np.zeros(0)
    gaps = gaps[gaps > 0.0]
    if not len(gaps):
        raise InputError(f"{run.root}: a dataset needs a run of several frames")
    return int(np.clip(round(1.0 / float(np.median(gaps))), 1, MOST_FPS))


def _stack(columns: Mapping[str, Any], names: Sequence[str]) -> np.ndarray:
    return np.stack([np.asarray(columns[name], dtype=np.float64) for name in names], axis=-1)


def _nearest(stamps: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Index of the stamp that is nearest to each instant."""
    after = np.clip(np.searchsorted(stamps, at), 1, max(len(stamps) - 1, 1))
    after = np.minimum(after, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(at - stamps[before] <= stamps[after] - at, before, after)


def _held(stamps: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Index of the last stamp up to each instant; -1 before the first."""
    return np.searchsorted(stamps, at, side="right") - 1


def _motion(frame: Mapping[str, np.ndarray]) -> np.ndarray:
    """Motion to the next row, in the axes of the pose: forward, left (m) and turn (rad); none in the last row."""
    ahead = {name: np.append(value[1:], value[-1:]) - value for name, value in frame.items()}
    cos, sin = np.cos(frame["yaw_rad"]), np.sin(frame["yaw_rad"])
    turn = np.arctan2(np.sin(ahead["yaw_rad"]), np.cos(ahead["yaw_rad"]))
    x, y = ahead["x_m"], ahead["y_m"]
    return np.stack([cos * x + sin * y, cos * y - sin * x, turn], axis=-1)


def _floors(floors: Mapping[str, Any] | None, stamps: np.ndarray) -> dict[str, np.ndarray]:
    """Camera to its last floor up to each row: plane, covariance, share of the points on it."""
    found: dict[str, np.ndarray] = {}
    cameras = np.array([] if floors is None else floors["camera"], dtype=object)
    for camera in sorted(set(cameras.tolist())):
        assert floors is not None
        mine = cameras == camera
        values = _stack(floors, ("nx", "ny", "nz", "height_m", *PLANE, "share"))[mine]
        held = _held(np.asarray(floors["stamp_s"])[mine], stamps)
        found[camera] = np.where(held[:, None] < 0, 0.0, values[held])
    return found


def _obstacles(tracks: Mapping[str, Any] | None, frame: Mapping[str, np.ndarray]) -> np.ndarray:
    """The nearest tracks of each row, one after the other, zeros where there are fewer."""
    rows = np.zeros((len(frame["stamp_s"]), OBSTACLES, len(OBSTACLE)))
    if tracks is None:
        return rows.reshape(len(rows), -1)
    stamps, values = np.asarray(tracks["stamp_s"]), _stack(tracks, OBSTACLE[1:])
    order = np.argsort(stamps, kind="stable")
    starts, ends = (
        np.searchsorted(stamps[order], frame["stamp_s"], side=side) for side in ("left", "right")
    )
    for k, (start, end) in enumerate(zip(starts, ends, strict=True)):
        mine = values[order[start:end]]
        away = np.hypot(mine[:, 0] - frame["x_m"][k], mine[:, 1] - frame["y_m"][k])
        near = mine[np.argsort(away, kind="stable")[:OBSTACLES]]
        rows[k, : len(near), 0], rows[k, : len(near), 1:] = 1.0, near
    return rows.reshape(len(rows), -1)


def _add_pictures(episode: Episode, run: RunFolder, summary: Mapping[str, Any], say: Say) -> None:
    """Colour and depth of every row, from the recording of the run; none if there is no recording."""
    place = run.path(RECORDING) if run.has(RECORDING) else Path(str(summary.get("recording") or ""))
    if not place.name:
        say(f"{run.root}: no pictures, for it was not recorded (`simulate --record`)")
        return
    try:
        stamps = {_same(one) for one in episode.stamps.tolist()}
        found = dict(_pictures(open_recording(place).frames(), stamps))
    except SurefootError as error:
        say(f"{run.root}: no pictures: {error}")
        return
    for name in (COLOUR, DEPTH):
        held = [(stamp, one[name]) for stamp, one in sorted(found.items()) if name in one]
        if not held:
            continue
        at = _nearest(np.array([stamp for stamp, _ in held]), episode.stamps)
        episode.pictures[name] = [held[k][1][0] for k in at]
        episode.shapes[name] = held[0][1][1]
        episode.stats[name] = _picture_stats([held[k][1][2] for k in at])


Encoded = tuple[bytes, tuple[int, int, int], np.ndarray]
"""A picture, its shape, and a sample of its values: (values, channels)."""


def _pictures(
    frames: Iterator[Frame], stamps: set[float]
) -> Iterator[tuple[float, dict[str, Encoded]]]:
    """Stamp and encoded pictures of the frames with these stamps."""
    for frame in frames:
        if _same(frame.stamp_s) not in stamps:
            continue
        found: dict[str, Encoded] = {}
        if frame.colour is not None:
            bgr = cv2.cvtColor(frame.colour.rgb, cv2.COLOR_RGB2BGR)
            data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
            found[COLOUR] = (data, frame.colour.rgb.shape, _sample(frame.colour.rgb / 255.0))
        z = _depth(frame)
        if z is not None:
            mm = np.clip(np.nan_to_num(1e3 * z), 0, 65535).round().astype(np.uint16)
            data = cv2.imencode(".png", mm)[1].tobytes()
            found[DEPTH] = (data, (*mm.shape, 1), _sample(mm[..., None].astype(np.float64)))
        yield frame.stamp_s, found


def _depth(frame: Frame) -> np.ndarray | None:
    """Depth along the optical axis, m, of the depth or else the time-of-flight camera."""
    if frame.depth is not None:
        return frame.depth.depth
    if frame.tof is None:
        return None
    x, y = frame.tof.camera.slopes
    return np.asarray(frame.tof.range_m / np.sqrt(1.0 + x**2 + y**2))


def _sample(picture: np.ndarray) -> np.ndarray:
    """Values of every few pixels, (values, channels)."""
    step = max(1, min(picture.shape[:2]) // 32)
    return picture[::step, ::step].reshape(-1, picture.shape[2])


def _picture_stats(samples: Sequence[np.ndarray]) -> dict[str, Any]:
    found = stats_of(np.concatenate(samples))
    shaped = {name: np.reshape(value, (-1, 1, 1)).tolist() for name, value in found.items()}
    return shaped | {"count": [len(samples)]}


def stats_of(values: np.ndarray) -> dict[str, Any]:
    """Statistics of (rows, values) over the rows."""
    found = {
        "min": values.min(axis=0), "max": values.max(axis=0), "mean": values.mean(axis=0), "std": values.std(axis=0),
        **{name: np.quantile(values, share, axis=0) for name, share in QUANTILES.items()},
    }  # fmt: skip
    return {name: value.tolist() for name, value in found.items()} | {"count": [len(values)]}


def _same(stamp_s: float) -> float:
    """A stamp as a file of text keeps it."""
    return round(stamp_s, SAME_DIGITS)
