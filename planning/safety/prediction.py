"""What a mover will do, learnt from what it did: lines, turning points, and the way it takes between them.

Little robots, and people who pace, go to and fro. Once one was seen to turn at a place it will turn there
again; and where it was seen to pass it will not turn. The tracks forget what is out of sight for twelve seconds,
so the lines are remembered here, and a track that comes to life on a known line inherits what was learnt
there. Where nothing was learnt a mover goes on, or turns at any moment.

Source: ours; navigation trials (most contacts come after a reversal).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from . import _prediction_kernels

REMEMBERED = 0.6  # probability that what is remembered really is where its line leads it


@dataclass(frozen=True)
class PredictionConfig:
    """What counts as the same line, and how far it is believed."""

    moving_share: float = 0.5  # ours: less probable movers teach nothing
    least_mps: float = 0.02  # ours: slower is noise
    sure_share: float = 0.5  # ours: deviation of the velocity, share of the speed, to learn from
    aside_m: float = 0.20  # ours: off a line by so much is another line; tracks are 5 cm wrong
    askew_deg: float = 25.0  # ours: the same for the direction
    beyond_m: float = 1.5  # ours: before or behind what was seen of a line, still on it
    speed_share: float = 0.5  # ours: another speed by so much is another mover
    long_m: float = 0.3  # ours: a line of this length has shown its mover's speed ...
    usual_share: float = 0.15  # ours: ... which differs from time to time by this share
    longest_gap_s: float = 10.0  # ours: out of sight for longer it may have turned twice
    contradicted_m: float = 0.25  # ours: seen so far behind a turning point, it is none
    fresh_share: float = 0.5  # ours: weight of a new sighting of a turning point
    most_mps: float = 0.25  # ours: estimated speeds are capped here
    remembered_s: float = 60.0  # ours: both ends known, its place is told for so long unseen
    lost_s: float = 30.0  # ours: ends not known, it counts as lost on its line for so long
    drift_mps: float = 0.012  # ours: how the told place grows vague, along the line
    lines: int = 40  # ours: remembered at most, the latest

    def __post_init__(self) -> None:
        for name, value in self.__dict__.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"prediction: {name}={value} must be positive and finite")


@dataclass(frozen=True)
class Forecast:
    """Where a mover will be.

    Args:
        places: At the times asked for, world frame, m.
        velocities: At these, m/s.
        learnt: Whether each place lies where it was seen to pass, or behind a turn that it was seen to
            make: there it will not turn otherwise.
        since_seen: Whether the way since it was last seen is known too: it need not be looked for elsewhere.
    """

    places: Float[np.ndarray, "n 2"]
    velocities: Float[np.ndarray, "n 2"]
    learnt: np.ndarray
    since_seen: bool


@dataclass
class Line:
    """A line that something goes to and fro on.

    Args:
        origin: A place on it, m.
        direction: Unit vector along it.
        speed_mps: Of what goes there.
        low, high: Ends of what was seen of it, m from the origin along the direction.
        turn_low, turn_high: Where it turns; NaN: not known.
        at, sense, seen_s: Last sighting: place, +1 or -1 for the direction of walking, stamp.
        track: Number of the track that was last seen on it.
    """

    origin: Float[np.ndarray, "2"]
    direction: Float[np.ndarray, "2"]
    speed_mps: float
    low: float
    high: float
    at: float
    sense: float
    seen_s: float
    track: int
    radius_m: float = 0.10
    turn_low: float = math.nan
    turn_high: float = math.nan
    sums: np.ndarray = field(default_factory=lambda: np.zeros(6))  # n, x, y, xx, xy, yy
    plain: tuple[float, ...] = field(init=False)  # origin and direction

    def __post_init__(self) -> None:
        self.turned_to(self.origin, self.direction)

    def turned_to(self, origin: np.ndarray, direction: np.ndarray) -> None:
        """Lie here from now on; arguments as of the line."""
        self.origin, self.direction = origin, direction
        self.plain = (*origin.tolist(), *direction.tolist())  # two numbers need no arrays

    def along(self, place: np.ndarray) -> float:
        """Coordinate of a place."""
        x, y, dx, dy = self._offset(place)
        return float(x * dx + y * dy)

    def aside(self, place: np.ndarray) -> float:
        """Distance of a place from the line."""
        x, y, dx, dy = self._offset(place)
        return abs(float(x * dy - y * dx))

    def _offset(self, place: np.ndarray) -> tuple[float, float, float, float]:
        """From the origin, and the direction."""
        (x, y), (x0, y0, dx, dy) = place.tolist(), self.plain
        return x - x0, y - y0, dx, dy


class MotionPatterns:
    """All lines learnt so far."""

    def __init__(self, config: PredictionConfig | None = None) -> None:
        self.config = config or PredictionConfig()
        self.lines: list[Line] = []

    def learn(self, obstacles: Sequence[Obstacle]) -> None:
        """Take in the tracks of now; those not seen since the last call teach nothing."""
        for obstacle in obstacles:
            if obstacle.moving >= self.config.moving_share and self._sure(obstacle):
                self._learn(obstacle)
        self.lines = sorted(self.lines, key=lambda line: line.seen_s)[-self.config.lines :]

    def forecast(
        self, obstacle: Obstacle, stamp_s: float, times: Float[np.ndarray, "n"]
    ) -> Forecast:
        """The way of a mover, as far as known.

        Args:
            obstacle: Gone straight on since it was seen (`Obstacle.gone_straight`).
            stamp_s: Now.
            times: From now on, s, ascending.
        """
        velocity = obstacle.velocity
        speed = float(np.hypot(*velocity))
        velocity = velocity * min(1.0, self.config.most_mps / max(speed, 1e-9))
        unseen = max(stamp_s - obstacle.seen_s, 0.0)
        seen_at = obstacle.position - obstacle.velocity * unseen
        line = self._line_of(obstacle, seen_at) if speed >= self.config.least_mps else None
        if line is None:
            places = seen_at + (unseen + times[:, None]) * velocity
            moving = np.broadcast_to(velocity, places.shape)
            return Forecast(places, moving, np.zeros(len(times), np.bool_), False)
        sense = 1.0 if float(velocity @ line.direction) >= 0.0 else -1.0
        start = line.along(seen_at)
        rate = min(self._rate(obstacle, line), self.config.most_mps)
        places, velocities = np.empty((len(times), 2)), np.empty((len(times), 2))
        learnt = np.empty(len(times), np.bool_)
        _prediction_kernels.back_and_forth(
            seen_at,
            sense,
            rate,
            unseen + times,
            line.direction,
            start,
            (line.low, line.high),
            (line.turn_low, line.turn_high),
            places,
            velocities,
            learnt,
        )
        known = math.isfinite(line.turn_high if sense > 0 else line.turn_low)
        return Forecast(places, velocities, learnt, known or bool(unseen > 0.0 and learnt[0]))

    def now(self, obstacle: Obstacle, stamp_s: float) -> Obstacle:
        """A mover where its line has led it by now; any other obstacle as it is."""
        if obstacle.moving < self.config.moving_share or stamp_s <= obstacle.seen_s:
            return obstacle
        forecast = self.forecast(obstacle, stamp_s, np.zeros(1))
        if not forecast.since_seen:
            return obstacle
        mean = np.concatenate([forecast.places[0], forecast.velocities[0]])
        state = Gaussian(mean, obstacle.state.covariance)
        return replace(obstacle, state=state, straight=None)

    def remembered(self, obstacles: Sequence[Obstacle], stamp_s: float) -> list[Obstacle]:
        """Movers that no track follows any more, but whose line is known from end to end.

        Returns:
            As if gone straight on since they were seen; `forecast` and `now` lead them along their lines.
        """
        found = []
        for line in self._deserted(obstacles, stamp_s, self.config.remembered_s):
            if not (math.isfinite(line.turn_low) and math.isfinite(line.turn_high)):
                continue
            unseen = stamp_s - line.seen_s
            velocity = line.sense * line.speed_mps * line.direction
            seen_at = line.origin + line.at * line.direction
            along = (0.05 + self.config.drift_mps * unseen) ** 2
            P = np.zeros((4, 4))
            P[:2, :2] = along * np.outer(line.direction, line.direction) + 0.05**2 * np.eye(2)
            P[2:, 2:] = np.eye(2) * 1e-4
            mean = np.concatenate([seen_at + velocity * unseen, velocity])
            found.append(
                Obstacle(
                    Gaussian(mean, P),
                    line.radius_m,
                    track=line.track,
                    moving=REMEMBERED,
                    seen_s=line.seen_s,
                )
            )
        return found

    def lost(self, obstacles: Sequence[Obstacle], stamp_s: float) -> list[Line]:
        """Lines that something was lost on, whose ends are not known: it may be anywhere there."""
        return [
            line
            for line in self._deserted(obstacles, stamp_s, self.config.lost_s)
            if not (math.isfinite(line.turn_low) and math.isfinite(line.turn_high))
        ]

    def _deserted(
        self, obstacles: Sequence[Obstacle], stamp_s: float, longest_s: float
    ) -> list[Line]:
        """Lines seen within a time that no present track is on."""
        tracks = {obstacle.track for obstacle in obstacles}
        lost = [
            line
            for line in self.lines
            if 0.0 < stamp_s - line.seen_s <= longest_s
            and line.track not in tracks
            and line.high - line.low > 0.2
        ]
        if not lost:
            return []
        taken = [
            self._line_of(obstacle, obstacle.position)
            for obstacle in obstacles
            if obstacle.moving >= self.config.moving_share
        ]
        return [line for line in lost if not any(line is other for other in taken)]

    def _sure(self, obstacle: Obstacle) -> bool:
        speed = float(np.hypot(*obstacle.velocity))
        P = obstacle.state.covariance[2:, 2:]
        sigma = math.sqrt(max(float(P[0, 0] + P[1, 1]) / 2.0, 0.0))
        return speed >= self.config.least_mps and sigma <= self.config.sure_share * speed

    def _rate(self, obstacle: Obstacle, line: Line) -> float:
        """Speed on a line, m/s: the track's and the line's own, each by how sure it is.

        A track that was just seen to turn knows its speed badly; on its line it had one before.
        """
        speed = float(np.hypot(*obstacle.velocity))
        if line.high - line.low < self.config.long_m:
            return speed
        P = obstacle.state.covariance[2:, 2:]
        own = max(float(line.direction @ P @ line.direction), 1e-12)
        usual = (self.config.usual_share * line.speed_mps) ** 2
        return (speed * usual + line.speed_mps * own) / (own + usual)

    def _line_of(self, obstacle: Obstacle, place: np.ndarray) -> Line | None:
        """The line that it is on: of those near and along, the nearest."""
        config, least = self.config, math.cos(math.radians(self.config.askew_deg))
        (x, y), (vx, vy) = place.tolist(), obstacle.velocity.tolist()
        speed = max(math.hypot(vx, vy), 1e-9)
        best, found = math.inf, None
        for line in self.lines:
            x0, y0, dx, dy = line.plain
            if abs(vx * dx + vy * dy) < least * speed:
                continue
            same = line.track == obstacle.track
            if not same and abs(speed - line.speed_mps) > config.speed_share * line.speed_mps:
                continue
            aside = abs((x - x0) * dy - (y - y0) * dx)
            at = (x - x0) * dx + (y - y0) * dy
            reach = 2.0 * config.beyond_m if same else config.beyond_m
            if not line.low - reach <= at <= line.high + reach:
                continue
            cost = aside * (0.5 if same else 1.0)
            if aside <= config.aside_m and cost < best:
                best, found = cost, line
        return found

    def _learn(self, obstacle: Obstacle) -> None:
        place, velocity = obstacle.position, obstacle.velocity
        speed = float(np.hypot(*velocity))
        line = self._line_of(obstacle, place)
        if line is None:
            direction = velocity / speed
            line = Line(
                place.copy(),
                direction,
                speed,
                0.0,
                0.0,
                0.0,
                1.0,
                obstacle.seen_s,
                obstacle.track,
                obstacle.radius_m,
            )
            self.lines.append(line)
            _straighten(line, place)
            return
        gap = obstacle.seen_s - line.seen_s
        if gap <= 0.0:
            return
        at = line.along(place)
        sense = 1.0 if float(velocity @ line.direction) > 0.0 else -1.0
        if sense != line.sense and gap <= self.config.longest_gap_s:
            turn = (line.at + at + line.sense * speed * gap) / 2.0
            turn = max(turn, at, line.at) if line.sense > 0.0 else min(turn, at, line.at)
            self._turned(line, turn)
        line.low, line.high = min(line.low, at), max(line.high, at)
        if at > line.turn_high + self.config.contradicted_m:
            line.turn_high = math.nan
        if at < line.turn_low - self.config.contradicted_m:
            line.turn_low = math.nan
        line.at, line.sense, line.seen_s, line.track = at, sense, obstacle.seen_s, obstacle.track
        line.speed_mps += 0.1 * (speed - line.speed_mps)
        _straighten(line, place)

    def _turned(self, line: Line, turn: float) -> None:
        """It turned there; an older opinion is mixed in if it is near."""
        name = "turn_high" if line.sense > 0.0 else "turn_low"
        old = getattr(line, name)
        if abs(old - turn) <= 2.0 * self.config.contradicted_m:
            turn = old + self.config.fresh_share * (turn - old)
        setattr(line, name, turn)


def _straighten(line: Line, place: np.ndarray) -> None:
    """Fit the direction to all places seen, once they are far enough apart to tell."""
    offset = place - line.origin
    x, y = float(offset[0]), float(offset[1])
    line.sums += np.array([1.0, x, y, x * x, x * y, y * y])
    if line.high - line.low < 0.3:
        return
    n, sx, sy, sxx, sxy, syy = line.sums
    a, b, c = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    angle = 0.5 * math.atan2(2.0 * b, a - c)
    direction = np.array([math.cos(angle), math.sin(angle)])
    direction = direction if float(direction @ line.direction) >= 0.0 else -direction
    middle = np.array([sx, sy]) / n
    line.turned_to(line.origin + middle - float(middle @ direction) * direction, direction)
    shift = float(middle @ line.direction) * line.direction - middle  # back into the sums
    line.sums = np.array(
        [
            n,
            sx + n * shift[0],
            sy + n * shift[1],
            sxx + 2 * shift[0] * sx + n * shift[0] ** 2,
            sxy + shift[0] * sy + shift[1] * sx + n * shift[0] * shift[1],
            syy + 2 * shift[1] * sy + n * shift[1] ** 2,
        ]
    )
