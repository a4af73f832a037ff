"""The maps of a run: grid round the robot, confidence, world map, and point clouds, led by the pipeline's poses."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from mapping.grid.confidence import ConfidenceLayer, looked_at
from mapping.grid.dynamic_traces import DynamicTraces
from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.grid.world_map import WorldMap
from mapping.io.clouds import CloudBuilder
from mapping.objects.footprints import Footprint
from mapping.objects.obstacle_cloud import ObstacleCloud
from perception.floor import classify
from perception.floor.segmented_view import (
    SegmentedView,
    colours_of,
    near_moving_obstacles,
    sees_through,
)
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from ..config.schema import Config


class RunMaps:
    """The maps that the pipeline keeps from frame to frame."""

    def __init__(self, config: Config) -> None:
        """Begin with empty maps."""
        self._config = config
        self.cloud = CloudBuilder(config.cloud)
        self.obstacle_cloud = ObstacleCloud(config.cloud)
        self._reset()

    def _reset(self) -> None:
        """Begin again with empty maps; the clouds stay."""
        self.world = WorldMap(self._config.world_map)
        self.grid: EgocentricGrid | None = None
        self.confidence: ConfidenceLayer | None = None
        self._mapped_s: float | None = None
        self._traces = DynamicTraces()

    def footprints(self) -> list[Footprint]:
        """Footprints of the static obstacles of the world map."""
        return self.obstacle_cloud.footprints(self.world, self._config.footprints)

    def update(
        self,
        frame: Frame,
        views: Sequence[SegmentedView],
        obstacles: Sequence[Obstacle],
        pose: Gaussian | None,
    ) -> None:
        """Enter the views of a frame.

        Args:
            frame: Of the sensors.
            views: Its classified depth images; without one nothing changes.
            obstacles: Tracks at this frame, map frame.
            pose: (x, y, yaw) of the body, map frame; without one the maps cover this frame alone.
        """
        if not views:
            return
        if pose is None:
            self._reset()
        here = np.zeros(2) if pose is None else pose.mean[:2]
        elapsed = 0.0 if self._mapped_s is None else frame.stamp_s - self._mapped_s
        self._mapped_s = frame.stamp_s
        if self.grid is None:
            self.grid = EgocentricGrid(self._config.grid, here)
            self.confidence = ConfidenceLayer(self.grid, self._config.confidence)
        assert self.confidence is not None
        self.grid.move(here)
        if pose is not None and frame.odometry is not None:
            self.obstacle_cloud.stand(here)
        self.confidence.decay(elapsed)
        for view in views:
            self._add(frame, view, obstacles, pose)
            self.confidence.see(
                looked_at(
                    view, self.grid, self._config.reach.of(view.sensor, view.depth).farthest_m
                )
            )
        traces = self._traces.update(obstacles, frame.stamp_s)
        for one in (self.grid, self.world):
            one.mark_moving(*traces)
            one.age(elapsed)

    def _add(
        self,
        frame: Frame,
        view: SegmentedView,
        obstacles: Sequence[Obstacle],
        pose: Gaussian | None,
    ) -> None:
        """Enter one view into grid, world map and point clouds."""
        assert self.grid is not None
        used = np.flatnonzero(view.classes != classify.OVERHANG)
        upright, points = view.upright.take(used, axis=0), view.points.of(used)
        is_obstacle = view.classes.take(used) != classify.FLOOR
        is_moving = is_obstacle.copy()
        is_moving[is_obstacle] = near_moving_obstacles(upright[is_obstacle, :2], obstacles)
        camera = view.T_map_camera.position
        floor = view.floor.moved(view.T_map_camera)
        x, y, depth = points.xyz.T
        drop = np.abs(upright[:, 2] - view.floor.offset_m) / depth
        stretch = np.sqrt(x * x + y * y + depth * depth) / depth
        through = partial(sees_through, view.depth, view.T_map_camera, view.floor.offset_m)
        self.grid.update(
            upright,
            is_obstacle,
            frame.stamp_s,
            camera[:2],
            is_moving=is_moving,
            sensor_height_m=view.floor.offset_m,
            sigma_m=points.sigma * drop,
            floor=floor,
            pose=pose,
            sees_through=through,
        )
        self.world.update(
            upright,
            is_obstacle,
            frame.stamp_s,
            np.array([*camera[:2], view.floor.offset_m]),
            is_moving=is_moving,
            sigma_m=points.sigma * stretch,
            floor=floor,
            pose=pose,
            sees_through=through,
        )
        colours = colours_of(view.points, view.depth, frame.colour)
        self.cloud.add(view.upright, colours)
        still = np.flatnonzero(is_obstacle & ~is_moving)
        self.obstacle_cloud.add(
            upright.take(still, axis=0),
            points.sigma.take(still),
            camera,
            pose,
            None if colours is None else colours.take(used.take(still), axis=0),
        )
