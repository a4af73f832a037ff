"""The moments of an offline verb: where a camera was and what it saw, for the replay page and for viewers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import UInt8

from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose3

from ..config.schema import Config
from ..results.moment import Moment
from ..results.moments import MomentWriter
from ..results.run_folder import RunFolder
from ..run.moment_recorder import EVERY_S, PICTURE_EVERY_S, colour_picture, depth_picture


class CameraMoments:
    """Writes estimates.mcap of placed images, one moment for all images of one stamp.

    Args:
        folder: Of the run.
        config: Ranges of the depth sensors.
        every_s, picture_every_s: Least time between two moments, and between two with pictures; 0 for all.
    """

    def __init__(
        self,
        folder: RunFolder,
        config: Config,
        every_s: float = EVERY_S,
        picture_every_s: float = PICTURE_EVERY_S,
    ) -> None:
        self._writer = MomentWriter(folder)
        self._config = config
        self._every_s, self._picture_every_s = every_s, picture_every_s
        self._last_s = self._pictured_s = -math.inf
        self._moment: dict[str, Any] | None = None

    def add(
        self,
        stamp_s: float,
        sensor: str,
        camera: Camera,
        T_map_camera: Pose3,
        depth: Depth | None = None,
        rgb: UInt8[np.ndarray, "k l 3"] | None = None,
        pose: Gaussian | None = None,
    ) -> None:
        """Add an image; images of one stamp follow each other.

        Args:
            stamp_s: Of the image.
            sensor: "tof", "stereo", "depth" or "colour".
            camera: Intrinsics of the sensor.
            T_map_camera: Its pose.
            depth: Its depth image.
            rgb: Colour picture.
            pose: (x, y, yaw) of camera or body.
        """
        if self._moment is None or self._moment["stamp_s"] != stamp_s:
            self._write()
            if stamp_s - self._last_s < self._every_s:
                return
            self._last_s = stamp_s
            self._moment = {"stamp_s": stamp_s, "pose": pose, "cameras": {}, "lenses": {}}
            if stamp_s - self._pictured_s >= self._picture_every_s:
                self._pictured_s = stamp_s
        moment = self._moment
        moment["cameras"][sensor] = T_map_camera
        moment["lenses"][sensor] = camera
        if self._pictured_s != stamp_s:
            return
        if rgb is not None and "colour" not in moment:
            moment["colour"] = colour_picture(rgb)
        if depth is not None and "depth" not in moment:
            moment |= depth_picture(depth, sensor, self._config)

    def close(self) -> None:
        """Write the last moment and close the file."""
        self._write()
        self._writer.close(())

    def _write(self) -> None:
        if self._moment is not None:
            self._writer.write(Moment(**self._moment))
            self._moment = None
