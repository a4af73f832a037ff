"""Faults of cameras: what arrives instead of the pictures, and a camera that points elsewhere than it is said to.

Depth that is gone is NaN, a grey or colour picture without light is black.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from perception.primitives.frame import ColourView, DepthView, Frame, RangeView, StereoView
from perception.primitives.pose import Pose3

View = RangeView | DepthView | StereoView | ColourView
V = TypeVar("V", RangeView, DepthView, StereoView, ColourView)
CAMERAS = ("tof", "depth", "stereo", "colour")
PIXELS = ("range_m", "amplitude", "depth", "left", "right", "rgb")
"""The images of a view, as its type names them."""


class Frozen:
    """Every camera repeats the last picture before the fault; the joint angles go on."""

    def __init__(self) -> None:
        self._last: dict[str, View] = {}

    def apply(self, frame: Frame, active: bool) -> Frame:
        """The pictures of before."""
        if active:
            return _with(frame, lambda name, view: _seen_as(view, self._last.get(name)))
        self._last |= dict(_views(frame))
        return frame


class Late:
    """Pictures arrive late, and are taken for pictures of now, with the joint angles of now."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._past: deque[tuple[float, dict[str, View]]] = deque()

    def apply(self, frame: Frame, active: bool) -> Frame:
        """Each picture replaced by the newest one that is old enough."""
        self._past.append((frame.stamp_s, dict(_views(frame))))
        arrived: dict[str, View] = {}
        for stamp_s, views in self._past:
            if stamp_s <= frame.stamp_s - self._seconds:
                arrived |= views
        while self._past and self._past[0][0] < frame.stamp_s - self._seconds - 5.0:
            self._past.popleft()
        if not active:
            return frame
        return _with(frame, lambda name, view: _seen_as(view, arrived.get(name)))


class HalfBlind:
    """The left half of every picture is gone."""

    def apply(self, frame: Frame, active: bool) -> Frame:
        """The pictures without their left half."""
        return _with(frame, lambda name, view: _without(view, 0.5)) if active else frame


class Blackout:
    """Nothing in any picture."""

    def apply(self, frame: Frame, active: bool) -> Frame:
        """Empty pictures."""
        return _with(frame, lambda name, view: _without(view, 1.0)) if active else frame


class Miscalibrated:
    """Every camera points elsewhere than its calibration says: turned to the right and upwards by the same angle."""

    def __init__(self, degrees: float) -> None:
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        pan = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        self._turn = Pose3.from_rotation(pan @ tilt, np.zeros(3))

    def apply(self, frame: Frame, active: bool) -> Frame:
        """The pictures with another pose of the camera."""
        return _with(frame, lambda _, view: _moved(view, lambda T: T @ self._turn), active)


class EncoderOffset:
    """The encoder of the head's pan joint is off."""

    def __init__(self, degrees: float) -> None:
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        pan = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        self._turn = Pose3.from_rotation(pan, np.zeros(3))

    def apply(self, frame: Frame, active: bool) -> Frame:
        """The pictures with the cameras turned about the body's axis."""
        return _with(frame, lambda _, view: _moved(view, lambda T: self._turn @ T), active)


def _views(frame: Frame) -> list[tuple[str, View]]:
    """Name and view of every camera with a picture in this frame."""
    found = [(name, getattr(frame, name)) for name in CAMERAS]
    return [(name, view) for name, view in found if view is not None]


def _with(frame: Frame, change: Callable[[str, Any], View | None], active: bool = True) -> Frame:
    """The frame with every view changed."""
    if not active:
        return frame
    changes: dict[str, Any] = {name: change(name, view) for name, view in _views(frame)}
    return replace(frame, **changes)


def _pixels(view: View) -> dict[str, np.ndarray]:
    """The images of a view by name."""
    found = {name: getattr(view, name, None) for name in PIXELS}
    return {name: image for name, image in found.items() if image is not None}


def _seen_as(view: V, other: View | None) -> V | None:
    """The view with the pixels of another one of the same camera; None without one."""
    return None if other is None else replace(view, **_pixels(other))  # type: ignore[arg-type]


def _without(view: V, share: float) -> V:
    """The view without a share of its columns, from the left."""
    images: dict[str, Any] = {}
    for name, image in _pixels(view).items():
        blind = image.copy()
        blind[:, : round(share * image.shape[1])] = 0 if image.dtype == np.uint8 else np.nan
        images[name] = blind
    return replace(view, **images)


def _moved(view: V, move: Callable[[Pose3], Pose3]) -> V:
    """The view with another pose of its camera on the body."""
    T = view.T_body_camera
    return view if T is None else replace(view, T_body_camera=move(T))
