"""Motion patterns of moving obstacles: lines, turning points, and the forecast along them.

Small robots, and people who pace, go back and forth. An obstacle that was seen to reverse at a place reverses there
again, and it does not reverse where it was seen to pass. Tracks end twelve seconds after the last sighting, so the
lines are kept here, and a new track on a known line inherits what was learnt there. An obstacle without a line goes
straight on or reverses at any time.

Source: ours; in the navigation trials most contacts follow a reversal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from . import _prediction_kernels

# all ours
REMEMBERED = 0.6  # probability that a remembered obstacle is where its line predicts it
LEARN_FROM = 0.5  # tracks with a lower probability of moving teach nothing
LEAST_MPS = 0.02  # slower motion is noise
SURE_SHARE = 0.5  # standard deviation of the velocity, as a share of the speed, to learn from
LATERAL_M = 0.20  # farther off a line is another line; tracks err by 5 cm
OBLIQUE_DEG = 25.0  # the same for the direction
BEYOND_M = 1.5  # beyond the observed ends of a line, still on it
SPEED_SHARE = 0.5  # a speed that differs by more belongs to another obstacle
LONG_M = 0.3  # a line of this length has shown the speed of its obstacle ...
SPEED_SPREAD = 0.15  # ... which varies by this share
LONGEST_GAP_S = 10.0  # ours: shorter than a track lives unseen; an obstacle out of sight for longer may have reversed twice
CONTRADICTED_M = 0.25  # a sighting this far beyond a turning point removes it
FRESH_SHARE = 0.5  # weight of a new sighting of a turning point
REMEMBERED_S = 60.0  # how long an obstacle between two known ends is predicted out of sight
DRIFT_MPS = 0.012  # growth of the deviation along the line while out of sight
LINES = 40  # lines kept, the latest


@dataclass(frozen=True)
class Forecast:
    """Predicted positions of a moving obstacle.

    Args:
        places: At the requested times, world frame, m.
        velocities: At the same times, m/s.
        since_seen: Whether its path since the last sighting is known too.
    """

    places: Float[np.ndarray, "n 2"]
    velocities: Float[np.ndarray, "n 2"]
    since_seen: bool


@dataclass
class Line:
    """A line along which an obstacle goes back and forth; coordinates are m from the origin along the direction.

    Args:
        origin: A point on the line, world frame, m.
        direction: Unit vector along it.
        speed_mps: Speed of the obstacle.
        low, high: Observed ends.
        at, sense, seen_s: Last sighting: coordinate, sign of the motion, stamp.
        track: Number of the track last seen on it.
        radius_m: Radius of the obstacle.
        turn_low, turn_high: Turning points; NaN if unknown.
        sums: n, and sums of x, y, xx, xy, yy of the sightings from the origin.
        scalars: Origin and direction as plain numbers, which are faster than arrays.
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
    sums: np.ndarray = field(default_factory=lambda: np.zeros(6))
    scalars: tuple[float, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.place(self.origin, self.direction)

    def place(self, origin: np.ndarray, direction: np.ndarray) -> None:
        """Set origin and direction."""
        self.origin, self.direction = origin, direction
        self.scalars = (*origin.tolist(), *direction.tolist())

    def along(self, place: np.ndarray) -> float:
        """Coordinate of a point."""
        x, y, dx, dy = self._offset(place)
        return float(x * dx + y * dy)

    def _offset(self, place: np.ndarray) -> tuple[float, float, float, float]:
        (x, y), (x0, y0, dx, dy) = place.tolist(), self.scalars
        return x - x0, y - y0, dx, dy


class MotionPatterns:
    """All lines learnt so far."""

    def __init__(self) -> None:
        self.lines: list[Line] = []

    def update(self, obstacles: Sequence[Obstacle]) -> None:
        """Learn from the present tracks; one without a sighting since the last call changes nothing."""
        for obstacle in obstacles:
            if obstacle.moving >= LEARN_FROM and self._sure(obstacle):
                self._learn(obstacle)
        self.lines = sorted(self.lines, key=lambda line: line.seen_s)[-LINES:]

    def forecast(
        self, obstacle: Obstacle, stamp_s: float, times: Float[np.ndarray, "n"]
    ) -> Forecast:
        """The predicted path of a moving obstacle.

        Args:
            obstacle: Under the hypothesis of straight motion since its last sighting (`Obstacle.gone_straight`).
            stamp_s: Present time.
            times: From the present on, s, ascending.
        """
        velocity = obstacle.velocity
        speed = float(np.hypot(*velocity))
        unseen = max(stamp_s - obstacle.seen_s, 0.0)
        seen_at = obstacle.position - obstacle.velocity * unseen
        line = self._line_of(obstacle, seen_at) if speed >= LEAST_MPS else None
        if line is None:
            places = seen_at + (unseen + times[:, None]) * velocity
            moving = np.broadcast_to(velocity, places.shape)
            return Forecast(places, moving, False)
        sense = 1.0 if float(velocity @ line.direction) >= 0.0 else -1.0
        start = line.along(seen_at)
        rate = self._rate(obstacle, line)
        places, velocities = np.empty((len(times), 2)), np.empty((len(times), 2))
        _prediction_kernels.back_and_forth(
            seen_at,
            sense,
            rate,
            unseen + times,
            line.direction,
            start,
            (line.turn_low, line.turn_high),
            places,
            velocities,
        )
        known = math.isfinite(line.turn_high if sense > 0 else line.turn_low)
        passed = unseen > 0.0 and line.low <= line.along(places[0]) <= line.high
        return Forecast(places, velocities, known or passed)

    def propagated(self, obstacle: Obstacle, stamp_s: float) -> Obstacle:
        """A moving obstacle at its predicted present position; any other obstacle unchanged."""
        if obstacle.moving < LEARN_FROM or stamp_s <= obstacle.seen_s:
            return obstacle
        forecast = self.forecast(obstacle, stamp_s, np.zeros(1))
        if not forecast.since_seen:
            return obstacle
        mean = np.concatenate([forecast.places[0], forecast.velocities[0]])
        state = Gaussian(mean, obstacle.state.covariance)
        return replace(obstacle, state=state, motion=None)

    def remembered(self, obstacles: Sequence[Obstacle], stamp_s: float) -> list[Obstacle]:
        """Moving obstacles without a track on lines with two known turning points.

        Returns:
            Obstacles under the hypothesis of straight motion; `forecast` and `propagated` follow their lines.
        """
        found = []
        for line in self._without_track(obstacles, stamp_s):
            if not (math.isfinite(line.turn_low) and math.isfinite(line.turn_high)):
                continue
            unseen = stamp_s - line.seen_s
            velocity = line.sense * line.speed_mps * line.direction
            seen_at = line.origin + line.at * line.direction
            along = (0.05 + DRIFT_MPS * unseen) ** 2
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

    def _without_track(self, obstacles: Sequence[Obstacle], stamp_s: float) -> list[Line]:
        """Lines with a sighting within the last `REMEMBERED_S` and no present track."""
        tracks = {obstacle.track for obstacle in obstacles}
        lost = [
            line
            for line in self.lines
            if 0.0 < stamp_s - line.seen_s <= REMEMBERED_S
            and line.track not in tracks
            and line.high - line.low > 0.2
        ]
        if not lost:
            return []
        taken = [
            self._line_of(obstacle, obstacle.position)
            for obstacle in obstacles
            if obstacle.moving >= LEARN_FROM
        ]
        return [line for line in lost if not any(line is other for other in taken)]

    def _sure(self, obstacle: Obstacle) -> bool:
        speed = float(np.hypot(*obstacle.velocity))
        P = obstacle.state.covariance[2:, 2:]
        sigma = math.sqrt(max(float(P[0, 0] + P[1, 1]) / 2.0, 0.0))
        return speed >= LEAST_MPS and sigma <= SURE_SHARE * speed

    def _rate(self, obstacle: Obstacle, line: Line) -> float:
        """Speed on a line, m/s: mean of the track's and the line's speed, weighted by their variances.

        Just after a reversal the speed of the track is uncertain; the line gives the one before.
        """
        speed = float(np.hypot(*obstacle.velocity))
        if line.high - line.low < LONG_M:
            return speed
        P = obstacle.state.covariance[2:, 2:]
        own = max(float(line.direction @ P @ line.direction), 1e-12)
        usual = (SPEED_SPREAD * line.speed_mps) ** 2
        return (speed * usual + line.speed_mps * own) / (own + usual)

    def _line_of(self, obstacle: Obstacle, place: np.ndarray) -> Line | None:
        """The nearest of the lines that agree with its position, heading and speed; None if none does."""
        least = math.cos(math.radians(OBLIQUE_DEG))
        (x, y), (vx, vy) = place.tolist(), obstacle.velocity.tolist()
        speed = max(math.hypot(vx, vy), 1e-9)
        best, found = math.inf, None
        for line in self.lines:
            x0, y0, dx, dy = line.scalars
            if abs(vx * dx + vy * dy) < least * speed:
                continue
            same = line.track == obstacle.track
            if not same and abs(speed - line.speed_mps) > SPEED_SHARE * line.speed_mps:
                continue
            lateral = abs((x - x0) * dy - (y - y0) * dx)
            at = (x - x0) * dx + (y - y0) * dy
            reach = 2.0 * BEYOND_M if same else BEYOND_M
            if not line.low - reach <= at <= line.high + reach:
                continue
            cost = lateral * (0.5 if same else 1.0)
            if lateral <= LATERAL_M and cost < best:
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
        if sense != line.sense and gap <= LONGEST_GAP_S:
            turn = (line.at + at + line.sense * speed * gap) / 2.0
            turn = max(turn, at, line.at) if line.sense > 0.0 else min(turn, at, line.at)
            self._turned(line, turn)
        line.low, line.high = min(line.low, at), max(line.high, at)
        if at > line.turn_high + CONTRADICTED_M:
            line.turn_high = math.nan
        if at < line.turn_low - CONTRADICTED_M:
            line.turn_low = math.nan
        line.at, line.sense, line.seen_s, line.track = at, sense, obstacle.seen_s, obstacle.track
        line.speed_mps += 0.1 * (speed - line.speed_mps)
        _straighten(line, place)

    def _turned(self, line: Line, turn: float) -> None:
        """Record a turning point; average it with an older one nearby."""
        name = "turn_high" if line.sense > 0.0 else "turn_low"
        old = getattr(line, name)
        if abs(old - turn) <= 2.0 * CONTRADICTED_M:
            turn = old + FRESH_SHARE * (turn - old)
        setattr(line, name, turn)


def _straighten(line: Line, place: np.ndarray) -> None:
    """Add a sighting and fit the line to all sightings once they are 0.3 m apart."""
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
    line.place(line.origin + middle - float(middle @ direction) * direction, direction)
    shift = (
        float(middle @ line.direction) * line.direction - middle
    )  # shifts the sums to the new origin
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
