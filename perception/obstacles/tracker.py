"""Multi-object tracking: data association, and birth and death of obstacle tracks.

Detections are assigned to tracks by global nearest neighbour on the logarithm of the density; Mahalanobis' distance
alone would favour uncertain tracks. A detection that is more likely a new obstacle starts a track. A track is
reported after a few detections. A young one that loses its obstacle, as it goes much faster than usual, begins again
with the speeds of people. It ends when it is not detected where it should be visible, or when its position is
too uncertain.

Source: Yoo and Kim 2010 (seed 001), sections 2 and 14; association, birth and death ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment

from ..filtering.consistency import Innovation
from ..primitives import plugins
from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian, deviation
from ..primitives.obstacle import MOVING, Obstacle
from ..primitives.pose import Pose2
from ..primitives.settings import setting
from .motion_model import MEMBERS, MODELS, MotionModel
from .record import Record, Snapshot, Through, doubt_carried
from .track import NEW_PER_M2, Detection, TrackConfig, alike

Visible = Callable[[Float[np.ndarray, "n 2"]], Bool[np.ndarray, "n"]]
"""Which places (n, 2), world frame, m, have a free line of sight in this frame."""

MISSES_OF_NEW = (
    2  # ours: frames without detection, though visible, that end a track not yet reported
)
SAME_SHARE = (
    0.5  # ours: tracks closer, and known better, than this share of their radii are one obstacle
)
PEOPLE_MPS = 1.0  # speed per axis of people, who walk at 1.4 m/s (Bohannon 1997)
YOUNG_S = 1.0  # ours: time after its first detection in which a lost track may be of somebody fast
PART_OF = (
    0.7  # ours: a detection inside a track, smaller than this share of its radius, is a part of it
)
PART_SHARE = 1.5  # ours: largest radius of a truncated detection, in radii of the track
PART_M = 0.03  # ours: position error of a truncated detection of the full radius
PART_OFF = 2.5  # ours: its growth per metre of missing radius


@dataclass(frozen=True)
class TrackerConfig:
    """Data association, birth and death of tracks."""

    hits_to_show: int = setting(3, "", "detections before a track is reported", "ours")
    misses_to_die: int = setting(
        5, "", "frames without detection, though visible, that end a track", "ours"
    )
    oldest_s: float = 20.0  # ours: a moving obstacle may be anywhere by then; time without detection that ends a track
    max_radius_m: float = setting(
        0.35, "m", "radius above which a detection is not tracked", "ours: furniture is in the map"
    )
    largest_sigma_m: float = 0.8  # ours: position uncertainty that ends a track
    motion_model: str = setting(
        "switching",
        "",
        "filter of one obstacle: switching (stands, straight, curving, turned, as an interacting-multiple-model filter), or package.module:Class",
        "seed 001; modes ours",
    )
    track: TrackConfig = field(default_factory=TrackConfig)

    def __post_init__(self) -> None:
        problem = plugins.check(self.motion_model, MODELS, "motion model")
        if problem is not None:
            raise ConfigError(f"tracker: {problem}")
        for name in ("hits_to_show", "misses_to_die"):
            if getattr(self, name) < 1:
                raise ConfigError(f"tracker: {name}={getattr(self, name)} must be at least 1")
        for name in ("oldest_s", "max_radius_m", "largest_sigma_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"tracker: {name}={value} must be positive and finite")


class ObstacleTracker:
    """All tracked obstacles."""

    def __init__(self, config: TrackerConfig | None = None) -> None:
        """Begin without tracks.

        Raises:
            InputError: A motion model of the user's cannot be loaded.
        """
        self.config = config or TrackerConfig()
        self._model()  # refuses what cannot be loaded
        self._records: list[Record] = []
        self._born = 0
        self._stamp_s: float | None = None
        self.innovations: list[Innovation] = []
        """Of the detections of this frame, by track number."""

    def _model(self) -> Callable[[Detection, Gaussian, TrackConfig], MotionModel]:
        """The class of the filters."""
        made: Callable[[Detection, Gaussian, TrackConfig], MotionModel] = plugins.load(
            self.config.motion_model, MODELS, "motion model", MEMBERS
        )
        return made

    @property
    def obstacles(self) -> list[Obstacle]:
        """Reported obstacles, world frame, in order of their track number."""
        return [
            Obstacle(
                record.track.state,
                record.track.radius_m,
                record.track.height_m,
                record.number,
                record.moving,
                record.seen_s,
                record.since_s,
                record.track.motion,
            )
            for record in self._records
            if record.hits >= self.config.hits_to_show
        ]

    def update(
        self,
        stamp_s: float,
        detections: Sequence[Detection],
        robot: Gaussian,
        visible: Visible | None = None,
        truncated: Sequence[Detection] = (),
        through: Through | None = None,
    ) -> None:
        """Predict to this frame and update with its detections.

        Args:
            stamp_s: Time of the frame, s; an earlier one than before counts as the same.
            detections: Body frame; those not finite or larger than `max_radius_m` are ignored.
            robot: Over (x, y, yaw), m and rad, world frame.
            visible: Which places have a free line of sight; None: unseen tracks only become more uncertain.
            truncated: Truncated detections, body frame: one that overlaps a track confirms it, and its visible
                part contains the centre.
            through: Which points of the map this frame sees through. A track with surface points counts as
                moving only if these have left their first place or entered one seen free; None: all may move.
        """
        before_s = self._stamp_s
        dt = 0.0 if before_s is None else max(stamp_s - before_s, 0.0)
        self._stamp_s = stamp_s
        for record in self._records:
            record.track.predict(dt, robot)
        usable = [seen for seen in detections if self._usable(seen)]
        given = self._associate(usable)
        given |= self._associate_fast(usable, given, stamp_s, robot)
        if stamp_s != before_s:  # else a second camera of the same instant
            self.innovations = []
        for index, choice in given.items():
            record = self._records[index]
            innovation = record.track.update(usable[choice])
            record.grow((stamp_s, usable[choice], robot), YOUNG_S)
            self.innovations.append(Innovation(record.number, innovation.whitened))
            record.seen_s, record.hits, record.misses = stamp_s, record.hits + 1, 0
            record.compare(Snapshot.of(usable[choice], stamp_s, robot, through))
        parts = self._parts(usable, set(given.values()), robot)
        truncated = [*truncated, *(usable[choice] for choice in parts)]
        confirmed = self._seen_in_part(set(given), truncated, robot)
        for index, part in confirmed.items():
            record = self._records[index]
            record.hits += 1
            if part is not None:
                whole = _from_part(part, record.track)
                record.track.update(whole)
                record.grow((stamp_s, whole, robot), YOUNG_S)
                record.seen_s, record.misses = stamp_s, 0
                record.compare(Snapshot.of(part, stamp_s, robot, through))
        self._miss(given.keys() | confirmed.keys(), visible)
        self._records = [record for record in self._records if self._survives(record, stamp_s)]
        taken = {*given.values(), *parts}
        for choice, seen in enumerate(usable):
            if choice not in taken:
                self._born += 1
                track = self._model()(seen, robot, self.config.track)
                youth = [(stamp_s, seen, robot)]
                record = Record(track, self._born, stamp_s, stamp_s, youth=youth)
                record.compare(Snapshot.of(seen, stamp_s, robot, through))
                self._records.append(record)
        self._merge(stamp_s)
        doubt_carried([one for one in self._records if one.seen_s == stamp_s])

    def _usable(self, seen: Detection) -> bool:
        numbers = [*seen.position.tolist(), *seen.covariance.ravel().tolist()]
        return all(map(math.isfinite, numbers)) and 0.0 <= seen.radius_m <= self.config.max_radius_m

    def _associate(self, detections: Sequence[Detection]) -> dict[int, int]:
        """Track index to detection index, one to one."""
        if not self._records or not detections:
            return {}
        return dict(sorted(_pairs([record.track for record in self._records], detections)))

    def _associate_fast(
        self,
        detections: Sequence[Detection],
        given: dict[int, int],
        stamp_s: float,
        robot: Gaussian,
    ) -> dict[int, int]:
        """Track index to detection index of young tracks that lost obstacles faster than usual; these tracks begin again."""
        usual = self.config.track
        taken = set(given.values())
        left = [k for k in range(len(detections)) if k not in taken]
        young = [
            index
            for index, record in enumerate(self._records)
            if index not in given and record.youth and stamp_s - record.since_s <= YOUNG_S
        ]
        if not left or not young or usual.speed_sigma_mps >= PEOPLE_MPS:
            return {}
        config = replace(usual, speed_sigma_mps=PEOPLE_MPS)
        fast = [self._retold(self._records[index], stamp_s, robot, config) for index in young]
        found = {}
        for row, column in sorted(_pairs(fast, [detections[k] for k in left])):
            self._records[young[row]].track = fast[row]
            found[young[row]] = left[column]
        return found

    def _retold(
        self, record: Record, stamp_s: float, robot: Gaussian, config: TrackConfig
    ) -> MotionModel:
        """The track of a young record by another prior, predicted to this frame."""
        (before_s, seen, pose), *later = record.youth
        track = self._model()(seen, pose, config)
        for then_s, seen, pose in later:
            track.predict(then_s - before_s, pose)
            track.update(seen)
            before_s = then_s
        track.predict(stamp_s - before_s, robot)
        return track

    def _seen_in_part(
        self, seen: set[int], truncated: Sequence[Detection], robot: Gaussian
    ) -> dict[int, Detection | None]:
        """Tracks without a detection that overlap a truncated one.

        Returns:
            Track index to the nearest truncated detection that is small enough; None if all are larger, or if that
            one is nearer to another track.
        """
        if not truncated:
            return {}
        places = _in_world(truncated, robot)
        radii = np.array([part.radius_m for part in truncated])
        found: dict[int, Detection | None] = {}
        nearest: dict[int, tuple[float, int]] = {}
        for index, record in enumerate(self._records):
            gap, radius = np.hypot(*(places - record.track.state.mean[:2]).T), record.track.radius_m
            over = gap < radii + radius
            if index in seen or not over.any():
                continue
            found[index] = None
            own = np.where(over & (radii <= PART_SHARE * radius), gap, np.inf)
            part = int(np.argmin(own))
            if own[part] < nearest.get(part, (np.inf, 0))[0]:
                nearest[part] = float(own[part]), index
        return found | {index: truncated[part] for part, (_, index) in nearest.items()}

    def _parts(
        self, detections: Sequence[Detection], taken: set[int], robot: Gaussian
    ) -> list[int]:
        """Indices of detections without a track that are a part of a mover: small ones inside its disc, as one leg."""
        left = [k for k in range(len(detections)) if k not in taken]
        if not left:
            return []
        places = _in_world([detections[k] for k in left], robot)
        found = set()
        for record in self._records:
            radius = record.track.radius_m
            if (
                record.moving >= MOVING
                and deviation(record.track.state.covariance[:2, :2]) < radius
            ):
                inside = np.hypot(*(places - record.track.state.mean[:2]).T) < radius
                found |= {
                    k
                    for k, within in zip(left, inside, strict=True)
                    if within and detections[k].radius_m < PART_OF * radius
                }
        return sorted(found)

    def _miss(self, seen: set[int], visible: Visible | None) -> None:
        """Count a miss for every unseen track in a visible place."""
        unseen = [i for i in range(len(self._records)) if i not in seen]
        if visible is None or not unseen:
            return
        places = np.array([self._records[i].track.state.mean[:2] for i in unseen])
        for i, in_view in zip(unseen, visible(places), strict=True):
            self._records[i].misses += int(in_view)

    def _survives(self, record: Record, stamp_s: float) -> bool:
        shown = record.hits >= self.config.hits_to_show
        limit = self.config.misses_to_die if shown else MISSES_OF_NEW
        if record.misses >= limit or stamp_s - record.seen_s > self.config.oldest_s:
            return False
        return deviation(record.track.state.covariance[:2, :2]) < self.config.largest_sigma_m

    def _merge(self, stamp_s: float) -> None:
        """Keep the older of two tracks of one obstacle, if one is seen now; one that has lost its own may be anywhere."""
        kept: list[Record] = []
        for record in self._records:
            x, y = record.track.state.mean[:2].tolist()
            for older in kept:
                a, b = older.track.state.mean[:2].tolist()
                same = SAME_SHARE * min(record.track.radius_m, older.track.radius_m)
                if stamp_s not in (record.seen_s, older.seen_s) or math.hypot(x - a, y - b) >= same:
                    continue
                if deviation(older.track.state.covariance[:2, :2]) < same:
                    break
            else:
                kept.append(record)
        self._records = kept


def _in_world(detections: Sequence[Detection], robot: Gaussian) -> Float[np.ndarray, "n 2"]:
    """Positions of detections, world frame, m."""
    return Pose2(*robot.mean.tolist()).apply(np.array([seen.position for seen in detections]))


def _from_part(part: Detection, track: MotionModel) -> Detection:
    """A truncated detection; the missing radius widens its covariance, as always the same side may be hidden."""
    off = PART_M + PART_OFF * abs(track.radius_m - part.radius_m)
    covariance = part.covariance + np.eye(2) * off**2
    return Detection(part.position, covariance, track.radius_m, track.height_m)


def _pairs(tracks: Sequence[MotionModel], detections: Sequence[Detection]) -> list[tuple[int, int]]:
    """One-to-one pairs of tracks and detections that are more likely of one obstacle than of a new one."""
    positions = np.array([seen.position for seen in detections])
    covariances = np.array([seen.covariance for seen in detections])
    density = np.array([track.density(positions, covariances) for track in tracks])
    radii = np.array([seen.radius_m for seen in detections])
    sigmas = np.array([seen.radius_sigma_m for seen in detections])
    density = density * alike(radii - np.array([[track.radius_m] for track in tracks]), sigmas)
    cost = -2.0 * np.log(np.maximum(density, 1e-300))
    gate = -2.0 * math.log(NEW_PER_M2)
    least = min(float(cost.min()), gate)
    return match(cost - least, gate - least)


def match(cost: Float[np.ndarray, "n m"], gate: float) -> list[tuple[int, int]]:
    """One-to-one pairs (row, column): as many as possible inside the gate, then the least total cost."""
    outside = gate * (min(cost.shape) + 1)  # exceeds all inside together
    rows, columns = linear_sum_assignment(np.where(cost <= gate, cost, outside))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if cost[r, c] <= gate]
