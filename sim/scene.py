"""A scene as values: what stands, what moves, where the floor is."""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives.landmark import Landmark
from perception.primitives.pose import Pose2

from .shapes import Cylinder, Shape


@dataclass(frozen=True)
class StaticObject:
    """Something that stands still.

    Args:
        name: For people: "sofa", "wall".
        parts: Its shapes.
        albedo: Share of infrared light that it returns, for the time-of-flight camera.
        wall: Whether it belongs to the building; walls are no obstacles to be listed.
    """

    name: str
    parts: tuple[Shape, ...]
    albedo: float = 0.6
    wall: bool = False


@dataclass(frozen=True)
class MovingObject:
    """A small robot that goes to and fro on a straight line, blind to everything.

    Args:
        name: For people.
        start: (x, y) of one end of its line, m.
        heading_rad: Direction of the line.
        speed_mps: Even, in both directions.
        reversal_s: Time from one end to the other.
        parts: Shapes about the origin of the moving_object, upright cylinders.
        albedo: As of a item.
        phase_s: How long it has walked when the world begins; None: the world draws it.

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
        """Of the circle about all its parts."""
        return max(math.hypot(*part.centre[:2]) + part.radius for part in self.parts)

    @property
    def height_m(self) -> float:
        """Its top."""
        return max(part.top_m for part in self.parts)

    @property
    def end(self) -> tuple[float, float]:
        """The other end of its line."""
        length = self.speed_mps * self.reversal_s
        return (
            self.start[0] + length * math.cos(self.heading_rad),
            self.start[1] + length * math.sin(self.heading_rad),
        )

    def state(self, seconds: float) -> tuple[float, float, float, float]:
        """(x, y, vx, vy) that long after it left its start, m and m/s."""
        turns, rest = divmod(seconds, self.reversal_s)
        there = turns % 2 == 0
        travelled = self.speed_mps * (rest if there else self.reversal_s - rest)
        speed = self.speed_mps if there else -self.speed_mps
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return (
            self.start[0] + c * travelled,
            self.start[1] + s * travelled,
            c * speed,
            s * speed,
        )


@dataclass(frozen=True)
class FloorArea:
    """A rectangle of flooring: material, (x_min, y_min, x_max, y_max), m; later areas cover earlier."""

    material: str
    extent: tuple[float, float, float, float]


@dataclass(frozen=True)
class Scene:
    """A world at rest, with what is to be done in it.

    Args:
        name, seed: What `load` was asked for.
        extent: (x_min, y_min, x_max, y_max) of the floor inside the walls, m.
        floor: Flooring; the first area covers all of the extent.
        static_objects: What stands still, walls and tag plates among it.
        moving_objects: What moves.
        landmarks: The tags, as the robot knows them beforehand.
        start: Where the robot stands at first.
        goals: Places to reach one after the other, m.
        floor_albedo: As of a item.
    """

    name: str
    seed: int
    extent: tuple[float, float, float, float]
    floor: tuple[FloorArea, ...]
    static_objects: tuple[StaticObject, ...]
    moving_objects: tuple[MovingObject, ...]
    landmarks: tuple[Landmark, ...]
    start: Pose2
    goals: tuple[tuple[float, float], ...]
    floor_albedo: float = 0.5

    @property
    def obstacles(self) -> tuple[StaticObject, ...]:
        """The items that are neither building nor tag."""
        return tuple(item for item in self.static_objects if not item.wall)
