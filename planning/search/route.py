"""The route: via points kept from one cycle to the next.

Every step the path is searched anew, but off the old path the ground counts as a little dearer: two ways
round an obstacle that cost the same would make the robot dither. If it does not get on for ten seconds, or
walks to and fro for a minute, the place where it is stuck is made dear for a while, so that the search
leads another way.

Source: ours, from the rules of cooperation of the four papers; search by seed 003.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import DARWIN_OP, RobotModel

from .astar import Path, prepare, search
from .potential import SearchConfig


@dataclass(frozen=True)
class RouteConfig:
    """Loyalty to the old path, and patience."""

    loyalty: float = 0.03  # ours: potential added off the old path; with alpha 5, 15 % of the way
    ring_m: float = 0.6  # ours: unseen ground added round the map, so that a way may leave it
    corridor_m: float = 0.30  # ours: it grows up to this distance from the old path
    passed_m: float = 0.15  # ours: a way point this near is passed
    patience_steps: int = 15  # own: 10 s at 0.65 s a step without progress
    progress_m: float = 0.10  # ours: less than this is no progress
    stride_m: float = (
        0.35  # ours: who came so far in that time walks on; half of what cruise would bring
    )
    turn_deg: float = 60.0  # ours: who turned so far in that time is about to
    to_and_fro_steps: int = 90  # ours: a minute; in which ...
    range_m: float = 1.0  # ours: ... the way left was never shorter or longer than this: stuck too
    memory_steps: int = 200  # ours: 130 s, for a stuck place to stay dear until the detour is made
    block_ahead_m: float = 0.30  # ours: where the trouble is taken to be; farther each time
    block_radius_m: float = 0.35  # ours
    block_penalty: float = 4.0  # ours: potential added there: dear, not forbidden

    def __post_init__(self) -> None:
        for name in ("patience_steps", "memory_steps", "to_and_fro_steps"):
            if getattr(self, name) < 1:
                raise ConfigError(f"route: {name}={getattr(self, name)} must be at least 1")
        for name in ("stride_m", "turn_deg", "range_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"route: {name}={value} must be positive and finite")


@dataclass
class _Block:
    """A place that was stuck, and for how many more updates it is remembered."""

    place: np.ndarray
    left: int


class Route:
    """Leads to one goal at a time; a new goal forgets the old path."""

    def __init__(
        self,
        search_config: SearchConfig,
        config: RouteConfig | None = None,
        robot: RobotModel = DARWIN_OP,
    ) -> None:
        self._search, self._robot = search_config, robot
        self._config = RouteConfig() if config is None else config
        self._goal: np.ndarray | None = None
        self._blocks: list[_Block] = []
        self._best = math.inf  # least straight-line-of-path distance left so far
        self._waited = 0
        self._poses: deque[Pose2] = deque(maxlen=self._config.patience_steps)
        self._lefts: deque[float] = deque(maxlen=self._config.to_and_fro_steps)
        self.path: Path | None = None
        """The path being walked, for display; None while there is none. Its costs include loyalty."""

    @property
    def detours(self) -> int:
        """Stuck places remembered at present."""
        return len(self._blocks)

    def update(
        self,
        probability: Float[np.ndarray, "rows columns"],
        unknown: Bool[np.ndarray, "rows columns"],
        origin: Float[np.ndarray, "2"],
        cell_m: float,
        robot: Pose2,
        goal: Float[np.ndarray, "2"],
    ) -> Float[np.ndarray, "2"]:
        """The via point to walk to now, world frame, m; to be called once per footstep.

        The map may be of any size; beyond it the ground counts as unseen. Where no path leads to the goal
        the robot's own place is returned: stay. `path` is then None.

        Args: as for `planning.search.astar.find_path`.
        """
        here = np.array([robot.x, robot.y])
        if self._goal is None or not np.array_equal(goal, self._goal):
            self._start_anew(goal)
        self._watch_progress(robot, goal)
        probability, unknown, origin = self._widened(probability, unknown, origin, cell_m, goal)
        penalty = self._penalty(probability.shape, origin, cell_m, here)
        ground = prepare(
            probability, unknown, origin, cell_m, here, self._search, penalty, self._robot
        )
        self.path = search(ground, here, goal, self._search, self._robot)
        return np.asarray(self.ahead(here)[0])

    def ahead(self, here: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n 2"]:
        """Way points still to come, the via point first, world frame, m; without a path the place itself."""
        if self.path is None:
            return here[None]
        points = self.path.waypoints[1:]
        away = np.hypot(*(points[:-1] - here).T) > self._config.passed_m
        return np.asarray(points[int(np.argmax(np.append(away, True))) :])

    def _start_anew(self, goal: np.ndarray) -> None:
        self._goal = goal.copy()
        self.path = None
        self._blocks = []
        self._best = math.inf
        self._waited = 0
        self._poses.clear()
        self._lefts.clear()

    def _watch_progress(self, robot: Pose2, goal: np.ndarray) -> None:
        """Count the steps since the way left last became shorter; remember the place if too many."""
        here = np.array([robot.x, robot.y])
        self._poses.append(robot)
        for block in self._blocks:
            block.left -= 1
        self._blocks = [block for block in self._blocks if block.left > 0]
        if self.path is None:
            return
        left = _length(self._rest(here)) + float(np.hypot(*(goal - self.path.waypoints[-1])))
        self._lefts.append(left)
        if left < self._best - self._config.progress_m:
            self._best, self._waited = left, 0
        else:
            self._waited += 1
        stuck = self._waited >= self._config.patience_steps and not self._gets_on()
        if stuck or self._walks_to_and_fro():
            place = _along(self._rest(here), self._config.block_ahead_m * (1 + self.detours))
            self._blocks.append(_Block(place, self._config.memory_steps))
            self._best, self._waited = math.inf, 0
            self._lefts.clear()
            self.path = None  # no loyalty to a path that does not lead on

    def _gets_on(self) -> bool:
        """Whether it walks or turns, though the way left is no shorter: it may just have been found to be longer."""
        began, ends = self._poses[0], self._poses[-1]
        came = math.hypot(ends.x - began.x, ends.y - began.y)
        turned = abs(wrap_angle(ends.yaw - began.yaw))
        return came >= self._config.stride_m or turned >= math.radians(self._config.turn_deg)

    def _walks_to_and_fro(self) -> bool:
        """Whether, for all its walking, the way left has been much the same."""
        lefts = self._lefts
        return len(lefts) == lefts.maxlen and max(lefts) - min(lefts) < self._config.range_m

    def _widened(
        self,
        probability: np.ndarray,
        unknown: np.ndarray,
        origin: np.ndarray,
        cell_m: float,
        goal: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The map with unseen ground all round it, the goal included.

        Else a goal near the border, once on the map and once not, would change the way at every step:
        on the map it must be reached over the map, beyond it the way may leave anywhere.
        """
        size = np.array(probability.shape[::-1]) * cell_m
        ring = self._config.ring_m
        low = np.maximum(ring, origin - goal + ring)
        high = np.maximum(ring, goal - origin - size + ring)
        left, below = np.ceil(low / cell_m).astype(int).tolist()
        right, above = np.ceil(high / cell_m).astype(int).tolist()
        sides = ((below, above), (left, right))
        return (
            _framed(probability, sides),
            _framed(unknown, sides),
            origin - np.array([left, below]) * cell_m,
        )

    def _penalty(
        self, shape: tuple[int, ...], origin: np.ndarray, cell_m: float, here: np.ndarray
    ) -> np.ndarray:
        """What is added to the potential: loyalty off the old path, and the places that were stuck."""
        if self.path is None:
            penalty = np.zeros(shape)
        else:
            loyalty, corridor_m = self._config.loyalty, self._config.corridor_m
            penalty = np.full(shape, loyalty)
            part, away = _distance_m(self._rest(here), shape, origin, cell_m, corridor_m)
            np.minimum(away * loyalty / corridor_m, loyalty, out=penalty[part])
        for block in self._blocks:
            row, column = (np.arange(n) + 0.5 for n in shape)
            x, y = origin[0] + column * cell_m, origin[1] + row * cell_m
            gap = np.hypot(x - block.place[0], y[:, None] - block.place[1])
            near = np.maximum(0.0, 1 - (gap / self._config.block_radius_m) ** 2)
            penalty = np.maximum(penalty, self._config.block_penalty * near)
        return penalty

    def _rest(self, here: np.ndarray) -> np.ndarray:
        """The old path from here on: way points already passed are dropped."""
        assert self.path is not None
        points = self.path.waypoints
        while len(points) > 2:
            way, ahead = points[1] - here, points[2] - points[1]
            if float(np.hypot(*way)) > self._config.passed_m and float(way @ ahead) > 0.0:
                break
            if float(np.hypot(*way)) > 2 * self._config.passed_m:
                break
            points = points[1:]
        return np.vstack([here, points[1:]])


def _framed(values: np.ndarray, sides: tuple[tuple[int, int], tuple[int, int]]) -> np.ndarray:
    """A map with so many rows of ones below and above, and columns to the left and right."""
    (below, above), (left, right) = sides
    rows, columns = values.shape
    wide = np.ones((below + rows + above, left + columns + right), values.dtype)
    wide[below : below + rows, left : left + columns] = values
    return wide


def _length(points: np.ndarray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _along(points: np.ndarray, distance: float) -> np.ndarray:
    """The point at a distance along a polyline; its end if it is shorter."""
    for begin, end in itertools.pairwise(points):
        piece = float(np.hypot(*(end - begin)))
        if piece >= distance > 0.0:
            return np.asarray(begin + (end - begin) * distance / piece)
        distance -= piece
    return np.asarray(points[-1])


def _distance_m(
    points: np.ndarray, shape: tuple[int, ...], origin: np.ndarray, cell_m: float, reach_m: float
) -> tuple[tuple[slice, slice], np.ndarray]:
    """A part of the map that holds all within reach of a polyline, and there the distance to its cells, m."""
    corners = np.floor((points - origin) / cell_m).astype(np.int32)
    wide = math.ceil(reach_m / cell_m) + 1
    left, low = (max(v - wide, 0) for v in corners.min(axis=0).tolist())
    right, high = (v + wide + 1 for v in corners.max(axis=0).tolist())
    part = np.s_[low:high, left:right]  # the robot is on the map, so that this is never empty
    off = np.ones(shape, np.uint8)[part]
    cv2.polylines(off, [(corners - [left, low]).reshape(-1, 1, 2)], False, 0)
    return part, cv2.distanceTransform(off, cv2.DIST_L2, 5).astype(np.float64) * cell_m
