"""Depth images of a frame, from whichever depth sensors it has.

Every part of the system that needs depth takes it from here, so that a recording gives the same depth to
`process`, `map`, `panorama` and `monocular`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import UInt8

from ..primitives import plugins
from ..primitives.errors import InputError
from ..primitives.frame import ColourView, Depth, DepthView, Frame
from ..primitives.own_body import OwnBody
from . import stereo, structured_light, time_of_flight
from .rectification import rectified
from .self_filter import without_self
from .stereo import StereoConfig
from .structured_light import StructuredLightConfig
from .time_of_flight import TofConfig

SENSORS = ("tof", "depth", "stereo")
"""Our sources, by the part of the frame that they use: time of flight, structured light, stereo."""

Stage = Callable[[str], AbstractContextManager[object]]
"""Times a block under a name, as `Stopwatch.stage` does."""

MIXED_PX, STEREO_MIXED_PX = 1.5, 6.0
"""Ours: pixels over which a sensor mixes a near edge with what is behind it; of stereo half the blocks it matches."""

FOR_ODOMETRY = ("depth", "stereo", "tof")  # ours: by field of view and resolution


@runtime_checkable
class DepthSource(Protocol):
    """A depth source of a user's own: a function, or a class whose objects are called."""

    def __call__(self, frame: Frame) -> Depth | None:
        """Depth with its standard deviation from whatever the frame holds; None if it cannot tell."""
        ...


class DepthImage(NamedTuple):
    """A depth image with the picture of the same pixels.

    Args:
        sensor: "tof", "depth", "stereo", or the name of the user's own source.
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
        names: The sources to use, of `SENSORS` or "package.module:Class".
        own_body: What is removed from every image, at the joint angles of the frame; None: nothing.
    """

    tof: TofConfig = field(default_factory=TofConfig)
    structured_light: StructuredLightConfig = field(default_factory=StructuredLightConfig)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    names: tuple[str, ...] = SENSORS
    own_body: OwnBody | None = None

    def __post_init__(self) -> None:
        self._frame: Frame | None = None
        self._images: dict[str, Depth | None] = {}
        self._own = _load(self.names)

    def images(self, frame: Frame, stage: Stage = nullcontext) -> Iterator[tuple[str, Depth]]:
        """Every depth image of a frame, in the order of `names`, each if present.

        Args:
            frame: Sensor data of one instant.
            stage: Times the computation, under "depth" or "stereo".

        Yields:
            Name of the source and its depth image.
        """
        for sensor in self.names:
            depth = self.image(frame, sensor, stage)
            if depth is not None:
                yield sensor, depth

    def image(self, frame: Frame, sensor: str, stage: Stage = nullcontext) -> Depth | None:
        """The depth image of one source; None if the frame has no such view, or the source is not used.

        Raises:
            InputError: A source of the user's returns something that is no depth image.
        """
        if self._frame is not frame:
            self._frame, self._images = frame, {}
        if sensor not in self._images and sensor in self.names:
            own = self._own.get(sensor)
            if own is not None:
                with stage("depth"):
                    self._images[sensor] = _checked(sensor, own(frame))
            elif getattr(frame, sensor) is not None:
                with stage("stereo" if sensor == "stereo" else "depth"):
                    self._images[sensor] = self._measure(frame, sensor)
            found = self._images.get(sensor)
            if found is not None and self.own_body is not None:
                mixed_px = STEREO_MIXED_PX if sensor == "stereo" else MIXED_PX
                with stage("self-filter"):
                    self._images[sensor] = without_self(
                        found, self.own_body, frame.joints, mixed_px
                    )
        return self._images.get(sensor)

    def for_odometry(self, frame: Frame) -> DepthImage | None:
        """The depth image that visual odometry aligns, with its picture; None without any depth."""
        for sensor in (*FOR_ODOMETRY, *self._own):
            depth = self.image(frame, sensor)
            if depth is not None:
                picture = registered_picture(frame, sensor)
                if sensor in self._own and frame.colour is not None:
                    same = frame.colour.rgb.shape[:2] == depth.z.shape
                    picture = frame.colour.rgb if same else None
                return DepthImage(sensor, depth, picture)
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
        """Without the images of the latest frame, which a checkpoint does not need, and without plug-ins."""
        return {**self.__dict__, "_frame": None, "_images": {}, "_own": None}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self._own = _load(self.names)


def _load(names: tuple[str, ...]) -> dict[str, DepthSource]:
    """The sources of the user's own, by name."""
    known = dict.fromkeys(SENSORS, "")
    found = {n: plugins.load(n, known, "depth source") for n in names if n not in known}
    return {name: one() if isinstance(one, type) else one for name, one in found.items()}


def _checked(name: str, found: object) -> Depth | None:
    """What a source of the user's returned, if it is a depth image or None."""
    if found is None:
        return None
    if not isinstance(found, Depth):
        raise InputError(
            f"depth source {name!r} returned a {type(found).__name__}; expected surefoot.Depth or None"
        )
    expected = (found.camera.height, found.camera.width)
    for part, image in (("z", found.z), ("sigma", found.sigma)):
        if image.shape != expected or image.dtype != np.float32:
            raise InputError(
                f"depth source {name!r}: {part} is {image.dtype} of shape {image.shape}; expected float32 "
                f"of shape {expected}, as its camera"
            )
    return found


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
