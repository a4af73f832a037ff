"""Looking aside for a step: where a mover should be that the picture ahead does not show.

A camera that always looks ahead loses who crosses, and what was lost may have turned back: the guard then
waits for phantoms. A glance tells. Every other step at most is one, and walks on to the place that was chosen
before it: the picture of a glance chooses none. Of several it goes to whoever could be here first, had it
turned back when it was last seen. Who waits and looks for nobody looks to both sides by turns.

Source: ours; the seed's head stays ahead.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from perception.primitives.errors import ConfigError
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, wrap_angle

from .command import angle_to


@dataclass(frozen=True)
class GlanceConfig:
    """Whom to look for, and how far round."""

    enabled: bool = True
    unseen_s: float = (
        0.5  # ours: who shows in the second picture of the last step is not looked for
    )
    reach_m: float = 1.3  # ours: farther, nobody comes within ten seconds
    from_deg: float = (
        35.0  # ours: nearer to the axis the picture ahead shows it, or something hides it
    )
    to_deg: float = 120.0  # ours: who is farther round is behind
    spare_deg: float = 20.0  # ours: the head stops short of it; where it is, is not known well
    most_deg: float = 75.0  # ours: the head turns no further

    def __post_init__(self) -> None:
        for name in ("unseen_s", "reach_m", "from_deg", "to_deg", "spare_deg", "most_deg"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"glance: {name}={value} must be positive and finite")


class Glances:
    """Lives from step to step."""

    def __init__(self, config: GlanceConfig, body_radius_m: float, top_speed_mps: float) -> None:
        """Look ahead.

        Args:
            config: Whom to look for.
            body_radius_m, top_speed_mps: Of this robot.
        """
        self._config = config
        self._radius_m, self._top_mps = body_radius_m, top_speed_mps
        self._aside = False
        self._side = 1.0  # where who waits looked last

    def next(
        self, robot: Pose2, movers: Sequence[Obstacle], stamp_s: float, waits: bool = False
    ) -> float:
        """Where to turn the head for the next step: pan, left positive, rad; 0 ahead.

        Args:
            robot: Where it stands, world frame.
            movers: Where they should be by now, world frame.
            stamp_s: Now, in the clock of `Obstacle.seen_s`.
            waits: Whether the robot gives way and hardly moves.
        """
        config = self._config
        if self._aside or not config.enabled:
            self._aside = False
            return 0.0
        wanted: list[tuple[float, float]] = []
        for mover in movers:
            away = math.hypot(mover.position[0] - robot.x, mover.position[1] - robot.y)
            side = angle_to(mover.position, robot)
            beside = config.from_deg <= abs(math.degrees(side)) <= config.to_deg
            unseen = stamp_s - mover.seen_s
            if beside and away < config.reach_m and unseen > config.unseen_s:
                closing = self._top_mps + math.hypot(*mover.velocity)
                left = (away - self._radius_m - mover.radius_m) / closing - unseen
                wanted.append((left, side))
        self._aside = bool(wanted) or waits
        if not wanted:
            self._side = -self._side if waits else self._side
            return self._side * math.radians(config.most_deg) if waits else 0.0
        _, side = min(wanted)
        pan = max(abs(side) - math.radians(config.spare_deg), 0.0)
        return wrap_angle(math.copysign(min(pan, math.radians(config.most_deg)), side))
