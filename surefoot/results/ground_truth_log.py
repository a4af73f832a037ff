"""Ground truth of a simulated run, written to truth/ in the run folder; only the evaluation reads it.

This is the only file of the application that imports `sim.truth`. It records each frame after its sensors
are rendered and before the planner decides; neither the pipeline nor a planner has access to it. Rows
go to disk at once, so that memory does not grow with the length of a run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from mapping.io.nav2 import save as save_map
from perception.floor.segmented_view import SegmentedView

from .row_stream import PoseStream, RowStream
from .run_folder import RunFolder

if TYPE_CHECKING:
    from sim.robot import SimulatedRobot
    from sim.scene import Scene

MAP_CELL_M = 0.05
BORDER_M = 0.05  # distance of the points of an outline that are checked for having been seen
HEIGHTS = (0.2, 0.5, 0.8, 0.98)  # of these points, as shares of the height below 0.5 m
REACH_M = 3.0  # range up to which a depth camera sees a side
SAMPLES = 5  # a cell is occupied if an object covers any of its 5 x 5 sample points


OBSTACLES = (
    "stamp_s",
    "identity",
    "x_m",
    "y_m",
    "vx_mps",
    "vy_mps",
    "radius_m",
    "height_m",
    "name",
)
OWN_BODY = ("stamp_s", "camera", "pixels", "points")
FLOOR = ("stamp_s", "camera", "nx", "ny", "nz", "height_m")


class TruthLog:
    """Writes the ground truth of every frame."""

    def __init__(self, robot: SimulatedRobot, scene: Scene, folder: RunFolder) -> None:
        from sim.truth import Truth

        self._folder = folder
        self._truth = Truth(robot)
        self._scene = scene
        self._poses = PoseStream(folder, "truth/trajectory.txt")
        self._obstacles = RowStream(folder, "truth/obstacles.csv", OBSTACLES)
        self._floors = RowStream(folder, "truth/floor.csv", FLOOR)
        self._faults = RowStream(folder, "truth/faults.csv", ("stamp_s", "fault"))
        self._clearances = RowStream(
            folder, "truth/clearance.csv", ("stamp_s", "clearance_m", "object")
        )
        self._own = RowStream(folder, "truth/own_body.csv", OWN_BODY)
        self._borders = [_Border(*one) for one in self._truth.outlines()]

    def note(
        self, stamp_s: float, faults: Sequence[str] = (), views: Sequence[SegmentedView] = ()
    ) -> None:
        """Record the ground truth of this frame, the faults that were put into it, and which of its points are of the robot itself."""
        for view in views:
            own = self._truth.own_pixels(view.sensor)
            if own is not None and own.shape == view.depth.z.shape:
                used = int(own.ravel()[view.points.pixels].sum())
                self._own.append((stamp_s, view.sensor, int(own.sum()), used))
        for fault in faults:
            self._faults.append((stamp_s, fault))
        pose = self._truth.robot_pose()
        self._poses.append((stamp_s, pose.x, pose.y, 0.0, pose.yaw))
        for obstacle, name in zip(self._truth.obstacles(), self._truth.names(), strict=True):
            self._obstacles.append((stamp_s, *obstacle, name))
        for camera in self._truth.cameras():
            floor = self._truth.floor(camera)
            self._floors.append((stamp_s, camera, *floor.normal.tolist(), floor.offset_m))
        unseen = [np.flatnonzero(~border.seen) for border in self._borders]
        points = [
            one.points[i].reshape(-1, 3) for one, i in zip(self._borders, unseen, strict=True)
        ]
        if sum(map(len, points)):
            in_view = self._truth.in_view(np.concatenate(points), REACH_M)
            parts = np.split(in_view, np.cumsum([len(one) for one in points])[:-1])
            for border, i, part in zip(self._borders, unseen, parts, strict=True):
                border.seen[i] = part.reshape(len(i), -1).any(axis=1) if len(i) else False
        clearance, nearest = self._truth.clearance_m()
        self._clearances.append((stamp_s, clearance, nearest))

    def finish(self) -> None:
        """Close all tables, and write the outlines and the occupancy map beside them."""
        folder = self._folder
        for table in (self._poses, self._obstacles, self._floors, self._clearances):
            table.close()
        self._faults.close(keep_empty=False)
        self._own.close(keep_empty=False)
        folder.write_json("truth/outlines.json", [border.entry() for border in self._borders])
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


class _Border:
    """The outline of a static obstacle, and which of its points a depth camera has seen.

    Its four sides are the directions of its longest straight side, to a quarter turn; a round thing has four too.
    """

    def __init__(
        self, identity: int, name: str, height_m: float, parts: list[Float[np.ndarray, "_ 2"]]
    ) -> None:
        self._head = {"identity": identity, "name": name, "height_m": height_m}
        self._parts = parts
        corners = np.concatenate(parts)
        ring = corners[ConvexHull(corners).vertices]
        steps = np.roll(ring, -1, axis=0) - ring
        lengths = np.linalg.norm(steps, axis=1)
        longest = steps[int(np.argmax(lengths))]
        first = math.atan2(longest[1], longest[0])
        turns = np.arctan2(steps[:, 1], steps[:, 0]) - first
        side = np.rint(turns / (math.pi / 2.0)).astype(int) % 4
        flat, self._side = [], []
        for corner, step, length, number in zip(ring, steps, lengths, side, strict=True):
            count = max(1, round(float(length) / BORDER_M))
            flat.append(corner + (np.arange(count)[:, None] + 0.5) / count * step)
            self._side += [(int(number), float(length) / count)] * count
        places = np.concatenate(flat)
        levels = np.array(HEIGHTS) * min(height_m, 0.5)
        self.points = np.concatenate(
            [
                np.repeat(places[:, None], len(levels), axis=1),
                np.broadcast_to(levels[None, :, None], (len(places), len(levels), 1)),
            ],
            axis=2,
        )
        self.seen = np.zeros(len(places), np.bool_)

    def entry(self) -> dict[str, Any]:
        """Of truth/outlines.json."""
        sides = []
        for number in range(4):
            own = [(s, m) for s, (k, m) in zip(self.seen, self._side, strict=True) if k == number]
            length = sum(m for _, m in own)
            seen = sum(m for s, m in own if s) / length if own else 0.0
            sides.append({"length_m": length, "seen": seen})
        return self._head | {"parts_m": [part.tolist() for part in self._parts], "sides": sides}
