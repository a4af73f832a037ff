"""Depth images of a frame, from whichever depth sensors it has.

Every part of the system that needs depth takes it from here, so that a recording gives the same depth to
`process`, `map`, `panorama` and `monocular`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8

from ..primitives.frame import ColourView, Depth, DepthView, Frame
from . import stereo, structured_light, time_of_flight
from .rectification import rectified
from .stereo import StereoConfig
from .structured_light import StructuredLightConfig
from .time_of_flight import TofConfig

Stage = Callable[[str], AbstractContextManager[object]]
"""Times a block under a name, as `Stopwatch.stage` does."""

FOR_ODOMETRY = ("depth", "stereo", "tof")  # ours: by field of view and resolution


class DepthImage(NamedTuple):
    """A depth image with the picture of the same pixels.

    Args:
        sensor: "tof", "depth" or "stereo".
        depth: Depth and its standard deviation.
        rgb: (h, w, 3) colour, or grey three times, registered to the depth; None if there is none.
    """

    sensor: str
    depth: Depth
    rgb: UInt8[np.ndarray, "h w 3"] | None


@dataclass
class DepthSources:
    """Time of flight, structured light and stereo, each with its noise model.

    The images of the latest frame are kept, so that several users of a frame share one computation.

    Args:
        tof: Noise and rejection of the time-of-flight camera.
        structured_light: Noise of an RGB-D camera.
        stereo: Matcher and thresholds of the stereo pair.
    """

    tof: TofConfig = field(default_factory=TofConfig)
    structured_light: StructuredLightConfig = field(default_factory=StructuredLightConfig)
    stereo: StereoConfig = field(default_factory=StereoConfig)

    def __post_init__(self) -> None:
        self._frame: Frame | None = None
        self._images: dict[str, Depth] = {}

    def images(self, frame: Frame, stage: Stage = nullcontext) -> Iterator[tuple[str, Depth]]:
        """Every depth image of a frame: time of flight, structured light, stereo, each if present.

        Args:
            frame: Sensor data of one instant.
            stage: Times the computation, under "depth" or "stereo".

        Yields:
            Name of the sensor ("tof", "depth", "stereo") and its depth image.
        """
        for sensor in ("tof", "depth", "stereo"):
            depth = self.image(frame, sensor, stage)
            if depth is not None:
                yield sensor, depth

    def image(self, frame: Frame, sensor: str, stage: Stage = nullcontext) -> Depth | None:
        """The depth image of one sensor; None if the frame has no such view."""
        if self._frame is not frame:
            self._frame, self._images = frame, {}
        if sensor not in self._images and getattr(frame, sensor) is not None:
            with stage("stereo" if sensor == "stereo" else "depth"):
                self._images[sensor] = self._measure(frame, sensor)
        return self._images.get(sensor)

    def for_odometry(self, frame: Frame) -> DepthImage | None:
        """The depth image that visual odometry aligns, with its picture; None without any depth."""
        for sensor in FOR_ODOMETRY:
            depth = self.image(frame, sensor)
            if depth is not None:
                return DepthImage(sensor, depth, registered_picture(frame, sensor))
        return None

    def _measure(self, frame: Frame, sensor: str) -> Depth:
        if sensor == "tof":
            assert frame.tof is not None
            return time_of_flight.depth(frame.tof, self.tof)
        if sensor == "depth":
            assert frame.depth is not None
            return structured_light.depth(frame.depth, self.structured_light)
        assert frame.stereo is not None
        return stereo.depth(rectified(frame.stereo), self.stereo)

    def __getstate__(self) -> dict[str, object]:
        """Without the images of the latest frame: a checkpoint has no use for them."""
        return {**self.__dict__, "_frame": None, "_images": {}}


def registered_picture(frame: Frame, sensor: str) -> UInt8[np.ndarray, "h w 3"] | None:
    """The picture whose pixels are those of a sensor's depth image; None if there is none.

    Args:
        frame: Sensor data of one instant.
        sensor: "tof", "depth" or "stereo"; the depth of a stereo pair has the pixels of its left image.
    """
    if sensor == "depth":
        colour = frame.colour
        return colour.rgb if colour is not None and registered(frame.depth, colour) else None
    if sensor == "stereo" and frame.stereo is not None:
        return np.asarray(cv2.cvtColor(rectified(frame.stereo).left, cv2.COLOR_GRAY2RGB))
    return None


def registered(depth: DepthView | None, colour: ColourView) -> bool:
    """Whether there is depth whose pixels are those of the colour picture."""
    return (
        depth is not None
        and depth.T_body_camera == colour.T_body_camera
        and depth.depth.shape == colour.rgb.shape[:2]
    )
