"""Ground truth of a simulated run, for evaluation only.

Sensors do not use this module: changing every answer below changes no frame.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.errors import InputError
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3

from .contact import nearest, robot_solid
from .robot import SimulatedRobot
from .scene import StaticObject
from .sensors.tof_camera import finer
from .shapes import Cylinder, Shape, distance, outline

ON_SURFACE_M = 0.03  # ours: a ray that ends this close to a point shows it
FIRST_STATIC_ID = 101  # ids of static objects start here, of moving objects at 1

ObstacleTruth = tuple[int, float, float, float, float, float, float]


class Truth:
    """Ground truth of one robot in its world at the current time."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self._robot = robot
        self._world = robot.world
        self._scene = robot.world.scene
        self._measures = robot.config.measures
        self._top_m = robot.config.walker.top_m
        self._still = [
            (FIRST_STATIC_ID + k, x, y, 0.0, 0.0, radius, max(part.top_m for part in item.parts))
            for k, item in enumerate(self._scene.obstacles)
            for x, y, radius in [_circle(item, self._top_m)]
        ]

    def robot_pose(self) -> Pose2:
        """True body frame in the world."""
        return self._robot.body.true_pose

    def cameras(self) -> tuple[str, ...]:
        """Enabled cameras, of "tof", "depth", "stereo" and "colour"."""
        return tuple(self._robot.cameras())

    def camera_pose(self, camera: str) -> Pose3:
        """True camera in the world; of the stereo pair the left one.

        Raises:
            InputError: for a camera that the robot does not have.
        """
        mounts = self._robot.cameras()
        if camera not in mounts:
            raise InputError(f"camera {camera!r} is not on this robot; it has {', '.join(mounts)}")
        return self._robot.camera_in_world(mounts[camera])

    def floor(self, camera: str) -> Plane:
        """Floor plane in the frame of a camera, normal up."""
        pose = self.camera_pose(camera)
        return Plane(pose.rotation[2].copy(), pose.translation[2])

    def obstacles(self) -> list[ObstacleTruth]:
        """(id, x, y, vx, vy, radius, height) of moving and static obstacles, m and m/s.

        The radius is that of the smallest circle about the centre of the outline below the robot's top.
        """
        found: list[ObstacleTruth] = []
        states = zip(self._scene.moving_objects, self._world.moving_states(), strict=True)
        for k, (one, (x, y, vx, vy)) in enumerate(states):
            found.append((k + 1, x, y, vx, vy, one.radius_m, one.height_m))
        return found + self._still

    def names(self) -> list[str]:
        """Names of the obstacles, in the order of `obstacles`."""
        moving = [one.name for one in self._scene.moving_objects]
        return [*moving, *(item.name for item in self._scene.obstacles)]

    def outlines(self) -> list[tuple[int, str, float, list[Float[np.ndarray, "k 2"]]]]:
        """(id, name, height, convex outlines of the parts below the robot's top) of the static obstacles, world frame, m."""
        found = []
        for k, item in enumerate(self._scene.obstacles):
            parts = [outline(part) for part in item.parts if part.bottom_m < self._top_m]
            height = max(part.top_m for part in item.parts)
            found.append((FIRST_STATIC_ID + k, item.name, height, parts))
        return found

    def in_view(self, points: Float[np.ndarray, "n 3"], farthest_m: float) -> Bool[np.ndarray, "n"]:
        """Whether points on surfaces are in the image of a depth camera now, in reach, and not hidden."""
        seen = np.zeros(len(points), np.bool_)
        config = self._robot.config
        cameras = {
            "tof": config.tof_camera.camera,
            "depth": config.depth_camera.camera,
            "stereo": config.stereo_camera.camera,
        }
        for name in set(self.cameras()) & set(cameras):
            pose = self.camera_pose(name)
            ahead = pose.inverse().apply(points)
            near = (ahead[:, 2] > 0.0) & (ahead[:, 2] < farthest_m) & ~seen
            near[near] = cameras[name].contains(cameras[name].project(ahead[near]))
            away = points[near] - pose.position
            distance_m = np.linalg.norm(away, axis=1)
            rays = (away / distance_m[:, None]).astype(np.float32)
            hits = self._world.rays.cast(pose.position, rays)
            seen[near] = np.abs(hits.distance_m - distance_m) < ON_SURFACE_M
        return seen

    def own_pixels(self, camera: str) -> Bool[np.ndarray, "h w"] | None:
        """Pixels of a depth camera of which any ray meets the robot itself; None where its links are not in the world.

        Raises:
            InputError: for a camera that measures no depth.
        """
        config = self._robot.config
        sizes = {
            "tof": (config.tof_camera.camera, config.tof_camera.sub_rays),
            "depth": (config.depth_camera.camera, 1),
            "stereo": (config.stereo_camera.camera, 1),
        }
        if camera not in sizes:
            raise InputError(f"camera {camera!r} measures no depth; choose {', '.join(sizes)}")
        if not self._world.carries:
            return None
        pixels, count = sizes[camera]
        seen = self._world.rays.shows_links(finer(pixels, count), self.camera_pose(camera))
        parts = seen.reshape(pixels.height, count, pixels.width, count)
        return np.asarray(parts.any(axis=(1, 3)))

    def clearance_m(self) -> tuple[float, str]:
        """Distance from the robot's solid to the nearest object, m, and the object's name.

        Zero or less means contact. The solid has the dimensions of `robot.dynamic.anatomy` for both bodies.
        """
        solid = robot_solid(self._robot.body, self._measures)
        still = [
            (item.name, part)
            for item in self._scene.static_objects
            if not item.ground
            for part in item.parts
        ]
        found = nearest(solid, still + self._moving_shapes())
        return found.gap_m, found.name

    def occupied(self, points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Whether points on the floor are covered by an object below the robot's top or lie outside the walls."""
        x0, y0, x1, y1 = self._scene.extent
        x, y = points[:, 0], points[:, 1]
        covered = (x < x0) | (x > x1) | (y < y0) | (y > y1)
        for _, shape in self._scene.static_shapes + self._moving_shapes():
            if shape.bottom_m < self._top_m:
                corners = outline(shape)
                (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
                near = np.flatnonzero((x >= left) & (x <= right) & (y >= low) & (y <= high))
                covered[near] |= distance(shape, points[near]) < 0.0
        return np.asarray(covered)

    def _moving_shapes(self) -> list[tuple[str, Shape]]:
        shapes: list[tuple[str, Shape]] = []
        states = zip(self._scene.moving_bodies, self._world.body_states(), strict=True)
        for (name, parts, _), (x, y, _, _) in states:
            for part in parts:
                px, py, pz = part.centre
                moved = Cylinder((x + px, y + py, pz), part.radius, part.height, part.material)
                shapes.append((name, moved))
        return shapes


def _circle(item: StaticObject, top_m: float) -> tuple[float, float, float]:
    """Centre and radius of a circle around an object's outline below the robot's top."""
    corners = np.concatenate(
        [outline(part) for part in item.parts if part.bottom_m < top_m]
        or [outline(part) for part in item.parts]
    )
    x, y = ((float(a) + float(b)) / 2 for a, b in zip(corners.min(0), corners.max(0), strict=True))
    return x, y, max(math.hypot(float(a) - x, float(b) - y) for a, b in corners)
