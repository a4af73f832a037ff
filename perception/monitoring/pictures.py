"""Pictures that show nothing, or nothing new.

A sensor's noise makes every picture differ from the one before. Where that is so, one that is equal in every pixel is
the same measurement again, and is not used twice; a camera without noise, as of a simulator, may see the same again. Of
a picture that is blind on one side, the other side is used, as the picture of a camera with a smaller field of view, so
that nobody takes what it cannot see for free.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool

from ..primitives.frame import ColourView, DepthView, Frame, RangeView, StereoView
from .status import NOTE, SLOW, STAND, Doubt

View = RangeView | DepthView | StereoView | ColourView
CAMERAS = {"tof": "range_m", "depth": "depth", "stereo": "left", "colour": "rgb"}
"""Part of the frame, and the image of it that is looked at."""
ROWS = 8  # ours: one row of so many is looked at
DARK = 12  # ours: grey levels up to which a pixel shows nothing
REPEATS = 2  # ours: equal pictures in a row that make a doubt
NOISY = 5  # ours: pictures in a row that differ show that the camera has noise
BLIND_SHARE = 0.25  # ours: of the columns, on one side, without any content
UNSEEN_S = 1.5  # ours: without any picture that shows something; two steps


@dataclass
class _Camera:
    """What is remembered of a camera: its last picture as a checksum, and how many in a row were equal or differed."""

    checksum: int = 0
    repeats: int = 0
    differed: int = 0

    @property
    def has_noise(self) -> bool:
        """Whether no two of its pictures should be equal."""
        return self.differed >= NOISY


class PictureWatch:
    """Looks at the pictures of a run, frame by frame."""

    def __init__(self) -> None:
        self._cameras: dict[str, _Camera] = {}
        self._seen_s: float | None = None

    def check(self, frame: Frame) -> tuple[Frame, list[Doubt]]:
        """The frame with the pictures that can be used, and what is wrong with the others."""
        doubts: list[Doubt] = []
        usable: dict[str, Any] = {}
        for name, image in CAMERAS.items():
            view = getattr(frame, name)
            if view is None:
                continue
            after, words = self._look(name, view, getattr(view, image))
            if words:
                asks = SLOW if name != "colour" and after is not None else NOTE
                doubts.append(Doubt(f"{name} {words}", asks))
            if after is not None:
                self._seen_s = frame.stamp_s
            if after is not view:
                usable[name] = after
        if self._seen_s is not None and frame.stamp_s - self._seen_s > UNSEEN_S:
            doubts.append(Doubt("no pictures", STAND))
        return (replace(frame, **usable) if usable else frame), doubts

    def _look(self, name: str, view: View, image: np.ndarray) -> tuple[View | None, str]:
        """What can be used of a view, and what is wrong with it."""
        rows = np.ascontiguousarray(image[::ROWS])
        content = _content(rows)
        if not content.any():
            return None, "empty"
        camera = self._cameras.setdefault(name, _Camera())
        checksum = zlib.crc32(rows.tobytes())
        equal = checksum == camera.checksum
        camera.checksum = checksum
        if not equal or camera.has_noise:
            camera.repeats = camera.repeats + 1 if equal else 0
            camera.differed += not equal
        else:
            camera.differed = 0
        if camera.repeats:
            return None, "frozen" if camera.repeats >= REPEATS else ""
        first, last = _sides(content)
        width = image.shape[1]
        if max(first, width - last) < BLIND_SHARE * width:
            return view, ""
        centre = min(max(view.camera.cx, 0.0), width - 1.0)  # a camera's picture reaches there
        first, last = min(first, math.ceil(centre)), max(last, math.floor(centre) + 1)
        return (view if name == "depth" else cut(view, first, last)), "half blind"


def cut(view: View, first: int, last: int) -> View:
    """The view with some of its columns only, as of a narrower camera."""
    camera = replace(view.camera, width=last - first, cx=view.camera.cx - first)
    images: dict[str, Any] = {
        name: np.ascontiguousarray(image[:, first:last])
        for name, image in vars(view).items()
        if isinstance(image, np.ndarray)
    }
    return replace(view, camera=camera, **images)


def _content(rows: np.ndarray) -> Bool[np.ndarray, "w"]:
    """Which columns show anything."""
    shown = rows > DARK if rows.dtype == np.uint8 else np.isfinite(rows)
    return np.asarray(shown.any(axis=tuple(axis for axis in range(rows.ndim) if axis != 1)))


def _sides(content: Bool[np.ndarray, "w"]) -> tuple[int, int]:
    """The first column with content, and the one behind the last."""
    columns = np.flatnonzero(content)
    return int(columns[0]), int(columns[-1]) + 1
