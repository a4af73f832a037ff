"""Pedestrians by social forces: drawn to a place, pushed away by others and by walls.

Source: Helbing and Molnar, Social force model for pedestrian dynamics, 1995; exponential repulsion of circles as in
Helbing, Farkas and Vicsek, 2000. Time and strength are scaled to the speed of the mover: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .ground import Ground
from .law import Mover, Velocity
from .waypoints import PAUSE_S, Waypoints

RELAX_S = 0.8  # ours; Helbing and Molnar: 0.5 s at 1.34 m/s
STRENGTH = 2.0  # ours: repulsion at contact, in units of the drive
RANGE_M = 0.15  # ours; Helbing and Molnar: 0.3 m at full size
WALL_STRENGTH, WALL_RANGE_M = 1.0, 0.10  # ours: it passes gaps that it fits through
SLOW, GIVES_UP_S = 0.2, 4.0  # ours: so slow for so long, it chooses another place
BEHIND = 0.5  # Helbing and Molnar: weight of what is out of sight
SIGHT_RAD = math.radians(100.0)  # Helbing and Molnar: half the angle of sight
MOST = 1.3  # Helbing and Molnar: greatest speed over the desired one


class SocialForce:
    """A pedestrian.

    Args:
        ground: Where it may be.
        speed_mps: The desired speed.
        tick_s: Of the traffic.
        rng: Draws places and pauses.
        reacts: Whether it sees the robot.
    """

    sidesteps = True

    def __init__(
        self,
        ground: Ground,
        speed_mps: float,
        tick_s: float,
        rng: np.random.Generator,
        reacts: bool,
    ) -> None:
        self._ground, self._speed_mps, self._tick_s = ground, speed_mps, tick_s
        self._goes = Waypoints(ground, speed_mps, tick_s, PAUSE_S, rng)
        self.reacts = reacts
        self._moved_s = 0.0

    def velocity(
        self, stamp_s: float, me: Mover, movers: Sequence[Mover], robot: Mover | None
    ) -> Velocity:
        """The velocity after one tick of drive and repulsion."""
        wx, wy = self._goes.velocity(stamp_s, me, movers, robot)
        ax, ay = (wx - me.vx) / RELAX_S, (wy - me.vy) / RELAX_S
        unit = STRENGTH * self._speed_mps / RELAX_S
        seen = [one for one in movers if one is not me]
        if self.reacts and robot is not None:
            seen.append(robot)
        for one in seen:
            dx, dy = me.x - one.x, me.y - one.y
            apart = math.hypot(dx, dy)
            if apart < 1e-6:
                continue
            push = unit * math.exp((me.radius_m + one.radius_m - apart) / RANGE_M)
            ahead = -(wx * dx + wy * dy) / (apart * max(math.hypot(wx, wy), 1e-6))
            push *= 1.0 if ahead >= math.cos(SIGHT_RAD) else BEHIND
            ax, ay = ax + push * dx / apart, ay + push * dy / apart
        clearance, nx, ny = self._ground.wall(me.x, me.y)
        push = WALL_STRENGTH / STRENGTH * unit
        push *= math.exp((me.radius_m - clearance) / WALL_RANGE_M)
        ax, ay = ax + push * nx, ay + push * ny
        vx, vy = me.vx + ax * self._tick_s, me.vy + ay * self._tick_s
        speed, most = math.hypot(vx, vy), MOST * self._speed_mps
        if speed > SLOW * self._speed_mps or (wx == 0.0 and wy == 0.0):
            self._moved_s = stamp_s
        elif stamp_s - self._moved_s > GIVES_UP_S:
            self.blocked(stamp_s)
        if speed > most:
            vx, vy = vx * most / speed, vy * most / speed
        if not self._ground.allows(me.x + vx * self._tick_s, me.y + vy * self._tick_s):
            inward = min(0.0, vx * nx + vy * ny)  # slides along the wall
            vx, vy = vx - inward * nx, vy - inward * ny
        return vx, vy

    def blocked(self, stamp_s: float) -> None:
        """Chooses another place."""
        self._goes.blocked(stamp_s)
