"""Ground of several levels during a run: the map of surfaces, led by the pipeline's poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mapping.ground.ground_map import GroundMap
from mapping.io import ground_file
from perception.floor.choose import FloorConfig
from perception.floor.segmented_view import SegmentedView
from perception.primitives.frame import Frame
from perception.primitives.pose import Pose2
from perception.terrain import segmentation

from ..config.schema import Config

SWAY_M, SWAY_RAD = 0.005, math.radians(0.5)
"""Ours: error of the trunk relative to the foot: sideways, m, and about the vertical, rad."""


class GroundWatch:
    """Keeps a `GroundMap` if that is enabled; it takes the first sensor whose place on the body is known."""

    def __init__(self, config: Config, floor: FloorConfig) -> None:
        self.map = GroundMap(config.ground) if config.ground.enabled else None
        self.body = Pose2()
        self.images = 0
        self._config, self._floor = config, floor
        self._sensor: str | None = None
        self._started, self._stamp_s = False, 0.0

    def entries(self) -> dict[str, Any] | None:
        """Content of ground.json; None before the first image."""
        if self.map is None or not self.images:
            return None
        return ground_file.entries(self.map.surfaces, self.body)

    def update(self, frame: Frame, views: Sequence[SegmentedView], pose: Pose2 | None) -> None:
        """Follow a frame.

        Args:
            frame: Of the sensors; without step odometry the body may have stepped all the time since the last one.
            views: Its depth images.
            pose: Of the body; without one nothing is mapped.
        """
        if self.map is None or pose is None:
            return
        if self._started:
            without = max(frame.stamp_s - self._stamp_s, 0.0) / self._config.gait.step_s
            steps = without if frame.odometry is None else frame.odometry.steps
            noise, height_m = self._config.localiser, self._config.prior.joints_height_m
            sigma = np.array(
                [noise.step_x_sigma_m, noise.step_y_sigma_m, noise.step_yaw_sigma_rad, height_m]
            )
            self.map.move(self.body.inverse() @ pose, 0.0, np.diag(sigma**2 * steps))
        self.body, self._started, self._stamp_s = pose, True, frame.stamp_s
        for view in views:
            mounted = view.depth.T_body_camera
            if mounted is None or self._sensor not in (None, view.sensor):
                continue
            self._sensor = view.sensor
            reach = self._config.reach.of(view.sensor, view.depth)
            regions = segmentation.find(view.depth, reach, self._floor, view.sensor)
            tilt = math.radians(self._config.prior.joints_tilt_deg)
            height_m = self._config.prior.joints_height_m
            sigma = np.array([SWAY_M, SWAY_M, height_m, tilt, tilt, SWAY_RAD])
            self.map.observe(regions, mounted, np.diag(sigma**2), view.depth.camera)
            self.images += 1
