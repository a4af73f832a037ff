"""Ground truth of a simulated run, written to truth/ in the run folder; only the evaluation reads it.

This is the only file of the application that imports `sim.truth`. It records each frame after its sensors
are rendered and before the planner decides; neither the pipeline nor a planner has access to it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mapping.io.nav2 import save as save_map

from .run_folder import RunFolder

if TYPE_CHECKING:
    from sim.robot import SimulatedRobot
    from sim.scene import Scene

MAP_CELL_M = 0.05
SAMPLES = 5  # a cell is occupied if an object covers any of its 5 x 5 sample points


class TruthLog:
    """Collects the ground truth of every frame."""

    def __init__(self, robot: SimulatedRobot, scene: Scene) -> None:
        from sim.truth import Truth

        self._truth = Truth(robot)
        self._scene = scene
        self._poses: list[tuple[float, float, float, float]] = []
        self._obstacles: list[tuple[object, ...]] = []
        self._floors: list[tuple[object, ...]] = []
        self._clearances: list[tuple[object, ...]] = []

    def note(self, stamp_s: float) -> None:
        """Record the ground truth of this frame."""
        pose = self._truth.robot_pose()
        self._poses.append((stamp_s, pose.x, pose.y, pose.yaw))
        for obstacle in self._truth.obstacles():
            self._obstacles.append((stamp_s, *obstacle))
        for camera in self._truth.cameras():
            floor = self._truth.floor(camera)
            self._floors.append((stamp_s, camera, *floor.normal.tolist(), floor.offset_m))
        clearance, nearest = self._truth.clearance_m()
        self._clearances.append((stamp_s, clearance, nearest))

    def write(self, folder: RunFolder) -> None:
        """Write all tables and the occupancy map to truth/ of the run folder."""
        folder.write_trajectory(
            "truth/trajectory.txt", [(s, x, y, 0.0, yaw) for s, x, y, yaw in self._poses]
        )
        folder.write_csv(
            "truth/obstacles.csv",
            ("stamp_s", "identity", "x_m", "y_m", "vx_mps", "vy_mps", "radius_m", "height_m"),
            self._obstacles,
        )
        folder.write_csv(
            "truth/floor.csv",
            ("stamp_s", "camera", "nx", "ny", "nz", "height_m"),
            self._floors,
        )
        folder.write_csv(
            "truth/clearance.csv", ("stamp_s", "clearance_m", "object"), self._clearances
        )
        x_min, y_min, x_max, y_max = self._scene.extent
        origin = np.array([x_min, y_min]) - 0.5
        columns = int(np.ceil((x_max - x_min + 1.0) / MAP_CELL_M))
        rows = int(np.ceil((y_max - y_min + 1.0) / MAP_CELL_M))
        x = origin[0] + (np.arange(columns * SAMPLES) + 0.5) * MAP_CELL_M / SAMPLES
        y = origin[1] + (np.arange(rows * SAMPLES) + 0.5) * MAP_CELL_M / SAMPLES
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        covered = self._truth.occupied(points).reshape(rows, SAMPLES, columns, SAMPLES)
        occupied = covered.any(axis=(1, 3))
        save_map(
            folder.path("truth"),
            "map",
            np.asarray(occupied, dtype=np.float32),
            np.ones_like(occupied),
            origin,
            MAP_CELL_M,
        )
