"""Traffic: all moving objects of a scene in one clock.

Objects that go to and fro among their like follow their closed form exactly. All others move in ticks of 0.1 s, one
after the other: each asks its law for a velocity and takes it if it then touches neither a static object nor another
mover; otherwise it stands and tells its law. The robot is in nobody's way except for laws that react to it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from ..free_space import ClearanceMap, clearance_map
from ..scene import TO_AND_FRO, MoverPose, MovingObject, MovingState, Place, Scene
from .company import Company
from .curves import Curves, Unicycle
from .ground import Ground
from .law import Law, Mover
from .lines import Line
from .social_force import SocialForce
from .waypoints import MINUTE_S, PASSING_S, PAUSE_S, Waypoints, sides

TICK_S = 0.1  # ours: 1 cm at 0.1 m/s
STRIDE_M = 0.05  # ours: of the places on a longer way that are checked; a cell of the ground
ROBOT_RADIUS_M = 0.15  # seed 001: S_r, for those who react to the robot
SIDESTEPS_RAD = tuple(math.radians(a) for a in (0.0, -40.0, 40.0, -80.0, 80.0))  # ours
_GAP_M = 0.02  # ours: between two movers
_KEPT_TICKS = 20  # ours: exposures look back by less


class Traffic:
    """The moving objects of a scene.

    Args:
        scene: The scene.
        seed: Draws the phase of each object that sets none, and all that the laws draw.
    """

    def __init__(self, scene: Scene, seed: int) -> None:
        self._objects = scene.moving_objects
        rng = np.random.default_rng([seed, 20])
        drawn = [float(rng.uniform(0.0, 2.0 * one.reversal_s)) for one in self._objects]
        self._phases = [
            phase if one.phase_s is None else one.phase_s
            for phase, one in zip(drawn, self._objects, strict=True)
        ]
        self._laws: list[Law] = []
        self._movers: list[Mover] = []
        self._grounds: list[Ground] = []
        self._ticks: deque[tuple[int, list[MoverPose]]] = deque(maxlen=_KEPT_TICKS)
        if any(one.law != TO_AND_FRO for one in self._objects):
            self._begin(scene, seed)

    def advance_to(self, stamp_s: float, robot: Place | None = None) -> None:
        """Move everybody up to a time.

        Args:
            stamp_s: Time, s; the first call begins at 0.
            robot: Where the robot is, m; None without one.
        """
        if not self._laws:
            return
        seen = None if robot is None else Mover(*robot, 0.0, 0.0, ROBOT_RADIUS_M)
        while (tick := self._ticks[-1][0]) * TICK_S <= stamp_s:
            for k in range(len(self._movers)):
                self._move(k, tick * TICK_S, seen)
            self._ticks.append((tick + 1, [_pose(one) for one in self._movers]))

    def poses(self, stamp_s: float) -> list[MoverPose]:
        """Everybody at a time near the last one that `advance_to` was given; beyond it at constant velocity."""
        if not self._laws:
            pairs = zip(self._objects, self._phases, strict=True)
            return [_exact(one, phase + stamp_s) for one, phase in pairs]
        place = max(0.0, stamp_s / TICK_S)
        number, poses = next(
            (one for one in reversed(self._ticks) if one[0] <= place), self._ticks[0]
        )
        after = next((one for one in self._ticks if one[0] == number + 1), None)
        late = (place - number) * TICK_S
        if after is None:
            return [(x + vx * late, y + vy * late, vx, vy, a, s) for x, y, vx, vy, a, s in poses]
        return [_between(one, next_, late) for one, next_ in zip(poses, after[1], strict=True)]

    def states(self, stamp_s: float) -> list[MovingState]:
        """(x, y, vx, vy) of everybody at such a time, m and m/s."""
        return [pose[:4] for pose in self.poses(stamp_s)]

    def body_states(self, stamp_s: float) -> list[MovingState]:
        """(x, y, vx, vy) of every piece of `Scene.moving_bodies` at such a time, m and m/s."""
        found = []
        for one, pose in zip(self._objects, self.poses(stamp_s), strict=True):
            found.append(pose[:4])
            if one.legs is not None:
                found += [one.legs.state(pose, side) for side in (1, -1)]
        return found

    def _begin(self, scene: Scene, seed: int) -> None:
        spaces: dict[float, ClearanceMap] = {}
        shapes = [part for _, part in scene.static_shapes]
        goals, start = scene.goals, (scene.start.x, scene.start.y)
        for k, (one, phase) in enumerate(zip(self._objects, self._phases, strict=True)):
            top = round(one.height_m, 1)
            if top not in spaces:
                spaces[top] = clearance_map(scene.extent, shapes, top_m=top)
            x, y, vx, vy = one.state(phase)
            ground = Ground(spaces[top], one.radius_m, (x, y), start, goals)
            self._grounds.append(ground)
            self._movers.append(Mover(*ground.at, 0.0, 0.0, one.radius_m, math.atan2(vy, vx)))
            self._laws.append(law_of(one, k, ground, np.random.default_rng([seed, 22, k])))
        self._ticks.append((0, [_pose(one) for one in self._movers]))

    def _move(self, k: int, stamp_s: float, robot: Mover | None) -> None:
        me, law = self._movers[k], self._laws[k]
        vx, vy = law.velocity(stamp_s, me, self._movers, robot)
        if vx == 0.0 and vy == 0.0:
            me.vx = me.vy = 0.0
            return
        others = [one for one in self._movers if one is not me]
        if robot is not None and isinstance(law, SocialForce) and law.reacts:
            others.append(robot)
        speed, heading = math.hypot(vx, vy), math.atan2(vy, vx)
        for turn in SIDESTEPS_RAD if law.sidesteps else (0.0,):
            vx, vy = speed * math.cos(heading + turn), speed * math.sin(heading + turn)
            x, y = me.x + vx * TICK_S, me.y + vy * TICK_S
            if self._may_go(k, (x, y), others):
                me.x, me.y, me.vx, me.vy = x, y, vx, vy
                me.heading_rad = math.atan2(vy, vx)
                me.travelled_m += speed * TICK_S
                return
        me.vx = me.vy = 0.0
        law.blocked(stamp_s)

    def _may_go(self, k: int, to: Place, others: Sequence[Mover]) -> bool:
        """Whether mover number k touches nothing on the straight way of one tick."""
        me = self._movers[k]
        dx, dy = to[0] - me.x, to[1] - me.y
        pieces = max(1, math.ceil(math.hypot(dx, dy) / STRIDE_M))
        on_the_way = (
            (me.x + dx * n / pieces, me.y + dy * n / pieces) for n in range(1, pieces + 1)
        )
        return all(self._grounds[k].allows(*at) and _clear(me, at, others) for at in on_the_way)


def law_of(one: MovingObject, k: int, ground: Ground, rng: np.random.Generator) -> Law:
    """The law of moving object number k by its name.

    The first object leads where its law follows; a group walks three abreast, streams cross.
    """
    speed, name = one.speed_mps, one.law
    if name in (TO_AND_FRO, "stop_and_go"):
        return Line(one, name == "stop_and_go", rng)
    if name == "curves":
        return Curves(ground, speed, TICK_S, rng)
    if name == "unicycle":
        return Unicycle(ground, speed, TICK_S, rng)
    if name.startswith("social_force"):
        return SocialForce(ground, speed, TICK_S, rng, name.endswith("reacting"))
    if name == "follower" and k > 0:
        return Company(ground, speed, TICK_S, k - 1, 0, rng)
    if name == "group" and k % 3:
        return Company(ground, speed, TICK_S, k - k % 3, 1 if k % 3 == 1 else -1, rng)
    if name == "stream":
        return Waypoints(ground, speed, TICK_S, PASSING_S, rng, sides(ground, k % 2 == 0, rng))
    if name == "standing":
        return Waypoints(ground, speed, TICK_S, MINUTE_S, rng, pauses_first=True)
    return Waypoints(ground, speed, TICK_S, PAUSE_S, rng)


def _clear(me: Mover, place: Place, others: Sequence[Mover]) -> bool:
    """Whether a step keeps a gap to everybody, or widens a gap that is too narrow."""
    for one in others:
        apart = math.dist(place, (one.x, one.y))
        if apart < me.radius_m + one.radius_m + _GAP_M and apart < math.dist(
            (me.x, me.y), (one.x, one.y)
        ):
            return False
    return True


def _pose(one: Mover) -> MoverPose:
    return one.x, one.y, one.vx, one.vy, one.heading_rad, one.travelled_m


def _exact(one: MovingObject, seconds: float) -> MoverPose:
    x, y, vx, vy = one.state(seconds)
    return x, y, vx, vy, math.atan2(vy, vx), one.speed_mps * seconds


def _between(one: MoverPose, after: MoverPose, late_s: float) -> MoverPose:
    """Some time after a pose on the straight way to the next; the velocity is that of the way."""
    vx, vy = (after[0] - one[0]) / TICK_S, (after[1] - one[1]) / TICK_S
    along = (after[5] - one[5]) / TICK_S
    return (
        one[0] + vx * late_s,
        one[1] + vy * late_s,
        vx,
        vy,
        after[4],
        one[5] + along * late_s,
    )
