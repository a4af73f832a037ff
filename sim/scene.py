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

MovingState = tuple[float, float, float, float]
"""(x, y, vx, vy), m and m/s."""

MoverPose = tuple[float, float, float, float, float, float]
"""(x, y, vx, vy, heading, travelled): m, m/s, rad, and the length of the path so far, m."""


@dataclass(frozen=True)
class StaticObject:
    """An object that does not move.

    Args:
        name: Such as "sofa" or "wall".
        parts: Its shapes.
        albedo: Infrared reflectance, for the time-of-flight camera.
        wall: Whether it belongs to the building; walls are not listed as obstacles.
        ground: Whether it may be stood on, on its level top; not listed as an obstacle either.
    """

    name: str
    parts: tuple[Shape, ...]
    albedo: float = 0.6
    wall: bool = False
    ground: bool = False


TO_AND_FRO = "to_and_fro"
"""The law of a moving object that goes back and forth on its segment and reacts to nothing."""


@dataclass(frozen=True)
class Legs:
    """Two upright cylinders that swing as a walker's feet: one stands on the floor while the other overtakes it.

    Args:
        radius: Of each, m.
        height: Of each, m.
        apart: Distance between them across the direction of motion, m.
        swing: Greatest offset ahead and behind, m: a quarter of the length of two steps.
        material: See `rendering.textures`.
    """

    radius: float
    height: float
    apart: float
    swing: float
    material: str

    @property
    def cylinder(self) -> Cylinder:
        """A leg about its own origin."""
        return Cylinder((0.0, 0.0, self.height / 2), self.radius, self.height, self.material)

    @property
    def reach_m(self) -> float:
        """Radius of the circle around both at every moment."""
        return math.hypot(self.apart / 2, self.swing) + self.radius

    def state(self, pose: MoverPose, side: int) -> MovingState:
        """(x, y, vx, vy) of the left (1) or right (-1) leg of a walker."""
        x, y, vx, vy, heading, travelled = pose
        share = (travelled / (4.0 * self.swing) + (0.25 if side > 0 else 0.75)) % 1.0
        stands = share < 0.5
        ahead = self.swing * (1.0 - 4.0 * share if stands else 4.0 * share - 3.0)
        across = side * self.apart / 2
        c, s = math.cos(heading), math.sin(heading)
        rate = 0.0 if stands else 2.0
        return (x + c * ahead - s * across, y + s * ahead + c * across, rate * vx, rate * vy)


@dataclass(frozen=True)
class MovingObject:
    """A robot or person that moves: back and forth on a line segment, or by another law that begins on the segment.

    Args:
        name: Such as "robot 1".
        start: (x, y) of one end of the segment, m.
        heading_rad: Direction of the segment.
        speed_mps: Constant speed in both directions.
        reversal_s: Time from one end to the other.
        parts: Upright cylinders about the origin of the object.
        albedo: Infrared reflectance.
        phase_s: Time since it left the start when the world starts; None: drawn by the world.
        law: Name of its law, see `movers`.
        legs: Below its parts; None without.

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
    law: str = TO_AND_FRO
    legs: Legs | None = None

    @property
    def radius_m(self) -> float:
        """Radius of the circle around all its parts; of a walker with legs, around these."""
        if self.legs is not None:
            return self.legs.reach_m
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

    def state(self, seconds: float) -> MovingState:
        """(x, y, vx, vy) at a time after it left its start, to and fro."""
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
        rooms: Floors of the rooms between their walls; none where a scene is not divided.
        doorways: Openings between rooms: (x, y) of the middle and width, m.
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
    rooms: tuple[Extent, ...] = ()
    doorways: tuple[tuple[float, float, float], ...] = ()

    @property
    def static_shapes(self) -> list[tuple[str, Shape]]:
        """Name of the object and shape, for every part of the static objects."""
        return [(item.name, part) for item in self.static_objects for part in item.parts]

    @property
    def moving_bodies(self) -> list[tuple[str, tuple[Cylinder, ...], float]]:
        """Name of the object, parts about their own origin, and albedo of all that moves as one piece.

        The parts of every moving object in order; after those of a walker with legs, the left leg and the right one.
        """
        found: list[tuple[str, tuple[Cylinder, ...], float]] = []
        for one in self.moving_objects:
            found.append((one.name, one.parts, one.albedo))
            if one.legs is not None:
                found += [(one.name, (one.legs.cylinder,), one.albedo)] * 2
        return found

    @property
    def obstacles(self) -> tuple[StaticObject, ...]:
        """Static objects that are neither building nor tag nor ground."""
        return tuple(item for item in self.static_objects if not (item.wall or item.ground))

    @property
    def ground(self) -> tuple[Shape, ...]:
        """What may be stood on above the floor; empty on flat ground."""
        return tuple(part for item in self.static_objects if item.ground for part in item.parts)
