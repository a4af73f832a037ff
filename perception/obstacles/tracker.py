"""Where are they: obstacles followed from frame to frame.

Detections are given to tracks so that all together they are likeliest (global nearest neighbour on the
logarithm of the density, not on Mahalanobis' distance alone, which favours the vague); what is likelier
something new begins a track. A track is shown when it was seen often
enough, and dies when it is not seen where it should be, or has become too vague to be of use.

Source: seed 001, sections 2 and 14; association and life of a track ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment

from ..filtering.consistency import Innovation
from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian
from ..primitives.obstacle import Obstacle
from .track import Detection, Track, TrackConfig

Visible = Callable[[Float[np.ndarray, "n 2"]], Bool[np.ndarray, "n"]]
"""Tells which places (n, 2), world frame, m, the sensors see in this frame, unhidden."""


PART_M = (
    0.03  # ours: deviation of the middle of a thing of which the view's edge hides next to nothing
)
PART_OFF = 2.5  # ours: and what each metre that its radius misses adds


@dataclass(frozen=True)
class TrackerConfig:
    """Gate, birth and death of tracks."""

    new_per_m2: float = 0.02  # ours: density of things never seen before, per frame in view
    hits_to_show: int = 3  # ours: sightings before a track is believed
    misses_to_die: int = 5  # ours: frames in view, unseen
    misses_of_newborn: int = 2  # ours: the same, before it is believed
    largest_sigma_m: float = 0.5  # ours: vaguer than this it says nothing
    oldest_s: float = (
        12.0  # ours: not seen for so long; by then a mover may be anywhere on its line
    )
    oldest_newborn_s: float = 3.0  # ours: the same, before it is believed
    max_radius_m: float = 0.35  # ours: larger is furniture, and the map's business
    radius_sigma_m: float = (
        0.012  # ours: of the radius of one thing between two looks at the whole of it
    )
    part_share: float = (
        1.5  # ours: what is seen of a thing in part is no larger than this share of it
    )
    unlike_share: float = 0.001  # ours: likelihood left to a thing of quite another size
    same_share: float = 0.5  # ours: closer than this share of their radii, two tracks are one thing
    track: TrackConfig = field(default_factory=TrackConfig)

    def __post_init__(self) -> None:
        for name in ("hits_to_show", "misses_to_die", "misses_of_newborn"):
            if getattr(self, name) < 1:
                raise ConfigError(f"tracker: {name}={getattr(self, name)} must be at least 1")
        for name in (
            "new_per_m2",
            "largest_sigma_m",
            "oldest_s",
            "oldest_newborn_s",
            "max_radius_m",
            "radius_sigma_m",
            "part_share",
            "unlike_share",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"tracker: {name}={value} must be positive and finite")


@dataclass
class _Life:
    """A track and the record of its sightings."""

    track: Track
    number: int
    since_s: float
    seen_s: float
    hits: int = 1
    misses: int = 0


class ObstacleTracker:
    """All obstacles that are followed."""

    def __init__(self, config: TrackerConfig | None = None) -> None:
        self.config = config or TrackerConfig()
        self._lives: list[_Life] = []
        self._born = 0
        self._stamp_s: float | None = None
        self.innovations: list[Innovation] = []
        """Of this frame's sightings, numbered by track; given out for judging consistency."""

    @property
    def obstacles(self) -> list[Obstacle]:
        """Those believed in, world frame, in order of their number."""
        return [
            Obstacle(
                life.track.state,
                life.track.radius_m,
                life.track.height_m,
                life.number,
                life.track.moving,
                life.seen_s,
                life.since_s,
                life.track.straight,
            )
            for life in self._lives
            if life.hits >= self.config.hits_to_show
        ]

    def update(
        self,
        stamp_s: float,
        detections: Sequence[Detection],
        robot: Gaussian,
        visible: Visible | None = None,
        partly: Sequence[Detection] = (),
    ) -> None:
        """Advance to this frame and learn from it.

        Args:
            stamp_s: Its time, s; not before the frame before (then no time passes).
            detections: What was seen, body frame; those not finite or larger than `max_radius_m` are ignored.
            robot: Over (x, y, yaw), m and rad, world frame.
            visible: Which places are in view and unhidden; None: unseen tracks only grow vague.
            partly: Things cut off by the edge of the view or half hidden, body frame: where one lies over a
                track the thing is still there, and its middle somewhere in what is seen.
        """
        before_s = self._stamp_s
        dt = 0.0 if before_s is None else max(stamp_s - before_s, 0.0)
        self._stamp_s = stamp_s
        for life in self._lives:
            life.track.predict(dt, robot)
        usable = [seen for seen in detections if self._usable(seen)]
        given = self._associate(usable)
        if stamp_s != before_s:  # two cameras of one instant tell one after the other
            self.innovations = []
        for index, choice in given.items():
            life = self._lives[index]
            surprise = life.track.update(usable[choice])
            self.innovations.append(Innovation(life.number, surprise.whitened))
            life.seen_s, life.hits, life.misses = stamp_s, life.hits + 1, 0
        there = self._seen_in_part(set(given), partly, robot)
        for index, part in there.items():
            life = self._lives[index]
            life.hits += 1
            if part is not None:
                life.track.update(_vague(part, life.track))
                life.seen_s = stamp_s
        self._miss(given.keys() | there.keys(), visible)
        self._lives = [life for life in self._lives if self._lives_on(life, stamp_s)]
        taken = set(given.values())
        for choice, seen in enumerate(usable):
            if choice not in taken:
                self._born += 1
                track = Track(seen, robot, self.config.track)
                self._lives.append(_Life(track, self._born, stamp_s, stamp_s))
        self._unite()

    def _usable(self, seen: Detection) -> bool:
        numbers = [*seen.position.tolist(), *seen.covariance.ravel().tolist()]
        return all(map(math.isfinite, numbers)) and 0.0 <= seen.radius_m <= self.config.max_radius_m

    def _associate(self, detections: Sequence[Detection]) -> dict[int, int]:
        """Track index to detection index, one to one; those who may have turned come second."""
        if not self._lives or not detections:
            return {}
        positions = np.array([seen.position for seen in detections])
        covariances = np.array([seen.covariance for seen in detections])
        density = np.array([life.track.density(positions, covariances) for life in self._lives])
        radii = np.array([seen.radius_m for seen in detections])
        known = np.array([life.track.radius_m for life in self._lives])
        unlike = (radii - known[:, None]) / self.config.radius_sigma_m
        density = density * np.maximum(np.exp(-0.5 * unlike**2), self.config.unlike_share)
        cost = -2.0 * np.log(np.maximum(density, 1e-300))
        gate = -2.0 * math.log(self.config.new_per_m2)
        least = min(float(cost.min()), gate)
        return dict(sorted(match(cost - least, gate - least)))

    def _seen_in_part(
        self, seen: set[int], partly: Sequence[Detection], robot: Gaussian
    ) -> dict[int, Detection | None]:
        """Tracks, not seen whole, that something seen in part lies over.

        Returns:
            Place of the track, and the nearest part that is small enough to be of it; None: larger ones only.
        """
        if not partly:
            return {}
        centres = np.array([part.position for part in partly])
        x, y, yaw = robot.mean.tolist()
        ahead = np.array([math.cos(yaw), math.sin(yaw)])
        places = np.array([x, y]) + centres[:, :1] * ahead + centres[:, 1:] * [-ahead[1], ahead[0]]
        radii = np.array([part.radius_m for part in partly])
        found: dict[int, Detection | None] = {}
        for index, life in enumerate(self._lives):
            gap, radius = np.hypot(*(places - life.track.state.mean[:2]).T), life.track.radius_m
            over = gap < radii + radius
            if index in seen or not over.any():
                continue
            own = over & (radii <= self.config.part_share * radius)
            found[index] = partly[int(np.argmin(np.where(own, gap, np.inf)))] if own.any() else None
        return found

    def _miss(self, seen: set[int], visible: Visible | None) -> None:
        unseen = [i for i in range(len(self._lives)) if i not in seen]
        if visible is None or not unseen:
            return
        places = np.array([self._lives[i].track.state.mean[:2] for i in unseen])
        for i, in_view in zip(unseen, visible(places), strict=True):
            self._lives[i].misses += int(in_view)

    def _lives_on(self, life: _Life, stamp_s: float) -> bool:
        shown = life.hits >= self.config.hits_to_show
        limit = self.config.misses_to_die if shown else self.config.misses_of_newborn
        oldest = self.config.oldest_s if shown else self.config.oldest_newborn_s
        if life.misses >= limit or stamp_s - life.seen_s > oldest:
            return False
        (a, b), (_, d) = life.track.state.covariance[:2, :2].tolist()
        largest = (a + d) / 2.0 + math.hypot((a - d) / 2.0, b)
        return largest < self.config.largest_sigma_m**2

    def _unite(self) -> None:
        """Of two tracks on one thing keep the older."""
        kept: list[_Life] = []
        places: list[tuple[float, float]] = []
        for life in self._lives:
            x, y = life.track.state.mean[:2].tolist()
            near = any(
                math.hypot(x - other[0], y - other[1])
                < self.config.same_share * min(life.track.radius_m, older.track.radius_m)
                for other, older in zip(places, kept, strict=True)
            )
            if not near:
                kept.append(life)
                places.append((x, y))
        self._lives = kept


def _vague(part: Detection, track: Track) -> Detection:
    """A thing seen in part, its middle as far off as it misses of its width: always the same side may be hidden."""
    off = PART_M + PART_OFF * abs(track.radius_m - part.radius_m)
    covariance = part.covariance + np.eye(2) * off**2
    return Detection(part.position, covariance, track.radius_m, track.height_m)


def match(cost: Float[np.ndarray, "n m"], gate: float) -> list[tuple[int, int]]:
    """Pairs (row, column), one to one, with as many as possible inside the gate and the least total cost."""
    outside = gate * (min(cost.shape) + 1)  # one pair outside costs more than all inside
    rows, columns = linear_sum_assignment(np.where(cost <= gate, cost, outside))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if cost[r, c] <= gate]
