"""A scene as values: static and moving objects, floor, landmarks, start and goals."""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives.landmark import Landmark
from perception.primitives.pose import Pose2

from .shapes import Cylinder, Shape

Extent = tuple[float, float, float, float]
"""(x_min, y_min, x_max, y_max), m."""

Place = tuple[float, float]
"""(x, y) on the floor, m."""


@dataclass(frozen=True)
class StaticObject:
    """An object that does not move.

    Args:
        name: Such as "sofa" or "wall".
        parts: Its shapes.
        albedo: Infrared reflectance, for the time-of-flight camera.
        wall: Whether it belongs to the building; walls are not listed as obstacles.
    """

    name: str
    parts: tuple[Shape, ...]
    albedo: float = 0.6
    wall: bool = False


@dataclass(frozen=True)
class MovingObject:
    """A robot or person that moves back and forth on a line segment and reacts to nothing.

    Args:
        name: Such as "robot 1".
        start: (x, y) of one end of the segment, m.
        heading_rad: Direction of the segment.
        speed_mps: Constant speed in both directions.
        reversal_s: Time from one end to the other.
        parts: Upright cylinders about the origin of the object.
        albedo: Infrared reflectance.
        phase_s: Time since it left the start when the world starts; None: drawn by the world.

    Source: seed 000, section 6 (robots d1 to d3).
    """

    name: str
    start: tuple[float, float]
    heading_rad: float
    speed_mps: float
    reversal_s: float
    parts: tuple[Cylinder, ...]
    albedo: float = 0.6
    phase_s: float | None = None

    @property
    def radius_m(self) -> float:
        """Radius of the circle around all its parts."""
        return max(math.hypot(*part.centre[:2]) + part.radius for part in self.parts)

    @property
    def height_m(self) -> float:
        """Height of its top."""
        return max(part.top_m for part in self.parts)

    @property
    def end(self) -> tuple[float, float]:
        """The other end of its segment."""
        length = self.speed_mps * self.reversal_s
        return (
            self.start[0] + length * math.cos(self.heading_rad),
            self.start[1] + length * math.sin(self.heading_rad),
        )

    def state(self, seconds: float) -> tuple[float, float, float, float]:
        """(x, y, vx, vy) at a time after it left its start, m and m/s."""
        reversals, rest = divmod(seconds, self.reversal_s)
        outward = reversals % 2 == 0
        travelled = self.speed_mps * (rest if outward else self.reversal_s - rest)
        speed = self.speed_mps if outward else -self.speed_mps
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return (self.start[0] + c * travelled, self.start[1] + s * travelled, c * speed, s * speed)


@dataclass(frozen=True)
class FloorArea:
    """A rectangle of flooring; later areas cover earlier ones."""

    material: str
    extent: Extent


@dataclass(frozen=True)
class Scene:
    """A world at rest and the task in it.

    Args:
        name, seed: Arguments of `scenes.catalogue.load`.
        extent: The floor inside the walls.
        floor: Flooring; the first area covers the whole extent.
        static_objects: Static objects, walls and tag plates included.
        moving_objects: Moving objects.
        landmarks: The tags, as the robot knows them.
        start: Start pose of the robot.
        goals: Goals in order, m.
        floor_albedo: Infrared reflectance of the floor.
    """

    name: str
    seed: int
    extent: Extent
    floor: tuple[FloorArea, ...]
    static_objects: tuple[StaticObject, ...]
    moving_objects: tuple[MovingObject, ...]
    landmarks: tuple[Landmark, ...]
    start: Pose2
    goals: tuple[tuple[float, float], ...]
    floor_albedo: float = 0.5

    @property
    def static_shapes(self) -> list[tuple[str, Shape]]:
        """Name of the object and shape, for every part of the static objects."""
        return [(item.name, part) for item in self.static_objects for part in item.parts]

    @property
    def obstacles(self) -> tuple[StaticObject, ...]:
        """Static objects that are neither building nor tag."""
        return tuple(item for item in self.static_objects if not item.wall)
