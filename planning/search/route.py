"""The route: one via point per footstep, with memory.

Every step searches the path anew, with a small penalty off the old path, so that the robot does not oscillate between two
paths of equal cost. If it makes no progress for ten seconds, or oscillates for a minute, the place ahead is penalised for
a while, and the search takes another path.

Source: ours, for the cooperation of the four papers; search by seed 003.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from mapping.grid.evidence import corner_m
from mapping.grid.world_map import WorldMap
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import DARWIN_OP, RobotModel
from perception.primitives.settings import setting

from .astar import Path, prepare, search
from .memory import Ground, with_memory
from .potential import SearchConfig

# all ours
RING_M = 0.6  # unseen ground added round the map, so that a path may leave it
HORIZON_M = 20.0
"""A goal further beyond the map is sought where the straight line to it passes this."""
CORRIDOR_M = 0.30  # distance from the old path at which the loyalty penalty is full
PASSED_M = 0.15  # distance at which a way point counts as passed
PROGRESS = 2.2  # cruising steps: least reduction of the remaining path that is progress
MOVED = 0.5  # part of what cruising covers in the patience; a robot that moved so far is not stuck
TURN_RAD, TURNED = math.radians(60.0), 0.3
"""Neither is one that turned by this angle, or by this part of its largest turns if that is less."""
OSCILLATION_STEPS = 90  # one minute: if the remaining path varied ...
RANGE = 0.25  # ... by less than this part of what cruising covers, the robot is stuck too
BLOCK_AHEAD_M = 0.30  # distance along the path of the place to avoid, times the number of detours
BLOCK_RADIUS_M = 0.35  # radius of that place
BLOCK_PENALTY = 4.0  # potential added there: expensive, not forbidden
NARROW_PENALTY = 4.0  # potential added where the guard would stop the robot
SWAY_M = 0.02  # of a walking DARwIn-OP: the penalty begins so far beyond the guard's distance
TURN_WITHIN_M = 0.35  # round a DARwIn-OP: ground on which the first turn of a path is paid


FOLLOW = ("points", "curve")


@dataclass(frozen=True)
class RouteConfig:
    """What the gait follows, loyalty to the old path, and patience."""

    follow: str = setting(
        "points",
        "",
        "the gait walks to the way points, or along the curve with its arcs as in seed 003",
        "ours",
    )
    loyalty: float = (
        0.03  # ours: 15 % of the path cost at alpha 5; potential added off the present path
    )
    patience_steps: int = 15  # ours: 10 s; steps without progress after which another path is taken
    memory_steps: int = 200  # ours: 130 s for which a place is avoided, enough for a detour

    def __post_init__(self) -> None:
        if self.follow not in FOLLOW:
            raise ConfigError(
                f"route: follow={self.follow!r} is unknown; choose {', '.join(FOLLOW)}"
            )
        for name in ("patience_steps", "memory_steps"):
            if getattr(self, name) < 1:
                raise ConfigError(f"route: {name}={getattr(self, name)} must be at least 1")


@dataclass
class _Block:
    """A place to avoid, and for how many more updates."""

    place: np.ndarray
    left: int


class Route:
    """The path to one goal at a time; a new goal discards it."""

    def __init__(
        self,
        search_config: SearchConfig,
        config: RouteConfig | None = None,
        robot: RobotModel = DARWIN_OP,
    ) -> None:
        self._search, self._robot = search_config, robot
        gait = robot.gait
        self._step_m = gait.cruise_mps * gait.step_s
        self._config = RouteConfig() if config is None else config
        self._goal: np.ndarray | None = None
        self._blocks: list[_Block] = []
        self._best = math.inf  # shortest remaining path so far
        self._waited = 0
        self._poses: deque[Pose2] = deque(maxlen=self._config.patience_steps)
        self._lefts: deque[float] = deque(maxlen=OSCILLATION_STEPS)
        self.path: Path | None = None
        """The present path; None without one. Its costs include the penalties."""

    @property
    def detours(self) -> int:
        """Number of places that are avoided at present."""
        return len(self._blocks)

    def update(
        self,
        probability: Float[np.ndarray, "rows columns"],
        unknown: Bool[np.ndarray, "rows columns"],
        origin: Float[np.ndarray, "2"],
        cell_m: float,
        robot: Pose2,
        goal: Float[np.ndarray, "2"],
        world_map: WorldMap | None = None,
    ) -> Float[np.ndarray, "2"]:
        """The present via point, world frame, m; call once per footstep.

        The map may be of any size; outside it the ground is as the world map remembers it, and unseen without one. Memory
        may be out of date: where it leaves no path, the search goes without it. Without a path to the goal the position of
        the robot is returned and `path` is None. The path to a goal beyond `HORIZON_M` ends there, on the straight line to it.

        Args: as for `planning.search.astar.find_path`, and the world map, of the same frame; None: no memory.
        """
        if self._goal is None or not np.array_equal(goal, self._goal):
            self._start_anew(goal)
        self._watch_progress(robot, goal)
        local = probability, unknown, origin
        grounds = [local] if world_map is None else [with_memory(local, cell_m, world_map), local]
        found = (self._searched(ground, cell_m, robot, goal) for ground in grounds)
        self.path = next((path for path in found if path is not None), None)
        return np.asarray(self.ahead(np.array([robot.x, robot.y]))[0])

    def _searched(
        self, ground: Ground, cell_m: float, robot: Pose2, goal: np.ndarray
    ) -> Path | None:
        """The path over a map, near the old one; None if there is none."""
        here = np.array([robot.x, robot.y])
        goal = _within_horizon(ground, cell_m, here, goal)
        probability, unknown, origin = self._widened(*ground, cell_m, goal)
        penalty = self._penalty(probability.shape, origin, cell_m, here)
        self._add_first_turn(penalty, origin, cell_m, robot)
        solid = ~unknown & (probability >= self._search.p_solid)
        np.maximum(penalty, self._narrow(solid, cell_m), out=penalty)
        terrain = prepare(
            probability, unknown, origin, cell_m, here, self._search, penalty, self._robot
        )
        return search(terrain, here, goal, self._search, self._robot)

    def ahead(self, here: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n 2"]:
        """Way points ahead, the via point first, world frame, m; without a path the position itself."""
        if self.path is None:
            return here[None]
        points = self.path.waypoints[1:]
        away = np.hypot(*(points[:-1] - here).T) > PASSED_M
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
        """Count the steps since the last progress; add a place to avoid after too many."""
        here = np.array([robot.x, robot.y])
        self._poses.append(robot)
        for block in self._blocks:
            block.left -= 1
        self._blocks = [block for block in self._blocks if block.left > 0]
        if self.path is None:
            return
        left = _length(self._rest(here)) + float(np.hypot(*(goal - self.path.waypoints[-1])))
        self._lefts.append(left)
        if left < self._best - PROGRESS * self._step_m:
            self._best, self._waited = left, 0
        else:
            self._waited += 1
        stuck = self._waited >= self._config.patience_steps and not self._moves()
        if stuck or self._oscillates():
            place = _along(self._rest(here), BLOCK_AHEAD_M * (1 + self.detours))
            self._blocks.append(_Block(place, self._config.memory_steps))
            self._best, self._waited = math.inf, 0
            self._lefts.clear()
            self.path = None  # no loyalty to this path

    def _moves(self) -> bool:
        """Whether the robot walks or turns without progress, as after the discovery that the path is longer."""
        began, ends = self._poses[0], self._poses[-1]
        came = math.hypot(ends.x - began.x, ends.y - began.y)
        turned = abs(wrap_angle(ends.yaw - began.yaw))
        steps, turn_rad = self._config.patience_steps, self._robot.gait.max_turn_rad
        turns = turned >= min(TURN_RAD, TURNED * steps * turn_rad)
        return turns or came >= MOVED * steps * self._step_m

    def _oscillates(self) -> bool:
        """Whether the length of the remaining path has hardly changed for a minute."""
        lefts = self._lefts
        return (
            len(lefts) == lefts.maxlen
            and max(lefts) - min(lefts) < RANGE * len(lefts) * self._step_m
        )

    def _widened(
        self,
        probability: np.ndarray,
        unknown: np.ndarray,
        origin: np.ndarray,
        cell_m: float,
        goal: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The map with unseen ground round it that includes the goal.

        Without it a goal near the border, alternately on the map and outside, would change the path at every step.
        """
        size = np.array(probability.shape[::-1]) * cell_m
        ring = RING_M
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
        """Penalties added to the potential: off the old path, and at the places to avoid."""
        if self.path is None:
            penalty = np.zeros(shape)
        else:
            loyalty = self._config.loyalty
            penalty = np.full(shape, loyalty)
            part, away = _distance_m(self._rest(here), shape, origin, cell_m, CORRIDOR_M)
            np.minimum(away * loyalty / CORRIDOR_M, loyalty, out=penalty[part])
        for block in self._blocks:
            row, column = (np.arange(n) + 0.5 for n in shape)
            x, y = origin[0] + column * cell_m, origin[1] + row * cell_m
            gap = np.hypot(x - block.place[0], y[:, None] - block.place[1])
            near = np.maximum(0.0, 1 - (gap / BLOCK_RADIUS_M) ** 2)
            penalty = np.maximum(penalty, BLOCK_PENALTY * near)
        return penalty

    def _add_first_turn(
        self, penalty: np.ndarray, origin: np.ndarray, cell_m: float, robot: Pose2
    ) -> None:
        """Add the turn with which a path begins, as the way that the gait would walk in that time.

        The search knows no heading: two paths of similar length, one ahead and one behind, would change places with
        every change of the map, and the robot would turn between them.
        """
        reach_m = self._robot.breadth * TURN_WITHIN_M
        y, x = (
            cell_m * (np.arange(n) + 0.5) + low - at
            for n, low, at in zip(penalty.shape, origin[::-1], (robot.y, robot.x), strict=True)
        )
        near = np.ix_(np.abs(y) <= reach_m, np.abs(x) <= reach_m)
        ahead, left = x[near[1]], y[near[0]]
        away = np.hypot(ahead, left)
        turn = np.abs((np.arctan2(left, ahead) - robot.yaw + math.pi) % (2.0 * math.pi) - math.pi)
        dear = (
            self._step_m / self._robot.gait.max_turn_rad / (max(self._search.alpha, 1e-9) * reach_m)
        )
        penalty[near] += np.where((away > cell_m) & (away <= reach_m), dear * turn, 0.0)

    def _narrow(self, solid: np.ndarray, cell_m: float) -> np.ndarray:
        """Penalty of places that the body may enter, but where the guard would stop it or the walk sways too far."""
        away = cv2.distanceTransform((~solid).view(np.uint8), cv2.DIST_L2, 5) * cell_m
        sway = self._robot.breadth * SWAY_M
        near = np.clip(self._robot.radius_m + corner_m(cell_m) + sway - away, 0.0, sway)
        return np.asarray(near * np.float32(NARROW_PENALTY / sway))

    def _rest(self, here: np.ndarray) -> np.ndarray:
        """The old path from the position on, without the way points already passed."""
        assert self.path is not None
        points = self.path.waypoints
        while len(points) > 2:
            way, ahead = points[1] - here, points[2] - points[1]
            if float(np.hypot(*way)) > PASSED_M and float(way @ ahead) > 0.0:
                break
            if float(np.hypot(*way)) > 2 * PASSED_M:
                break
            points = points[1:]
        return np.vstack([here, points[1:]])


def _within_horizon(
    ground: Ground, cell_m: float, here: np.ndarray, goal: np.ndarray
) -> np.ndarray:
    """The goal, or where the straight line to it is `HORIZON_M` beyond the map."""
    probability, _, origin = ground
    way, size = goal - here, np.array(probability.shape[::-1]) * cell_m
    end = np.where(way > 0.0, origin + size + HORIZON_M, origin - HORIZON_M)
    share = np.min((end - here) / np.where(way == 0.0, 1e-9, way), where=way != 0.0, initial=1.0)
    return goal if share >= 1.0 else here + share * way


def _framed(values: np.ndarray, sides: tuple[tuple[int, int], tuple[int, int]]) -> np.ndarray:
    """A map with rows of ones below and above it and columns of ones to the left and right."""
    (below, above), (left, right) = sides
    rows, columns = values.shape
    wide = np.ones((below + rows + above, left + columns + right), values.dtype)
    wide[below : below + rows, left : left + columns] = values
    return wide


def _length(points: np.ndarray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _along(points: np.ndarray, distance: float) -> np.ndarray:
    """The point at a distance along a polyline, or its end."""
    for begin, end in itertools.pairwise(points):
        piece = float(np.hypot(*(end - begin)))
        if piece >= distance > 0.0:
            return np.asarray(begin + (end - begin) * distance / piece)
        distance -= piece
    return np.asarray(points[-1])


def _distance_m(
    points: np.ndarray, shape: tuple[int, ...], origin: np.ndarray, cell_m: float, reach_m: float
) -> tuple[tuple[slice, slice], np.ndarray]:
    """The part of the map within reach of a polyline, and the distance of its cells to the polyline, m."""
    corners = np.floor((points - origin) / cell_m).astype(np.int32)
    wide = math.ceil(reach_m / cell_m) + 1
    left, low = (max(v - wide, 0) for v in corners.min(axis=0).tolist())
    right, high = (v + wide + 1 for v in corners.max(axis=0).tolist())
    part = np.s_[low:high, left:right]  # not empty, since the robot is on the map
    off = np.ones(shape, np.uint8)[part]
    cv2.polylines(off, [(corners - [left, low]).reshape(-1, 1, 2)], False, 0)
    return part, cv2.distanceTransform(off, cv2.DIST_L2, 5).astype(np.float64) * cell_m
