"""What is worth a look now: the four evaluations from live covariances, laid over pan and tilt.

To the seed's evaluations two reasons are added, both ours. A mover that was not seen for a while is worth the
more the longer and the nearer, at both places where it may be by now: of all contacts in our walks most are
with something unseen for two seconds. And the way ahead grows urgent while nobody looks there, so that it is
never left for long. What a look has just shown is worth little at once: the stale ground, by its confidence,
the way, by the time since, landmarks, by how much less vague they would make the robot's place.

Source: seed 001, section 3; seeking, urgency and the landmarks' gain are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Float32

from mapping.confidence import ConfidenceLayer
from mapping.egocentric_grid import EgocentricGrid
from perception.clusters import Cluster
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.obstacle import Obstacle

from ..commands import GazeCommand
from . import evaluations
from .evaluations import EvaluationConfig
from .selection import GazeMapConfig, in_view, shown
from .tag_gain import gains

BODY_M = 0.15  # S_r, seed 001
LARGEST_M = 0.35  # as the tracker: larger is furniture
EVERY = 3  # of the sample points is laid over the map: a fifth of the view holds dozens still
MET_S = 20.0  # how long a look at a thing that got no track is remembered
WAY_M = 1.0  # so far ahead the floor of the next steps lies


LIVE_MAP = GazeMapConfig(
    evaluation=EvaluationConfig(self_sigma_m=0.03),
    step_deg=3.0,
    map_weight=0.20,
    obstacle_weight=0.40,
)
"""Ours: with tags the place is known to 1 or 2 cm, which by T_sf = 0.10 m would never turn the head; contacts
are with what nobody looked at, so movers weigh more than stale ground; 3 deg take half the time of 2 deg."""


@dataclass(frozen=True)
class AttentionConfig:
    """Directions and weights, and how urgency grows."""

    map: GazeMapConfig = field(default_factory=lambda: LIVE_MAP)
    ground_m: float = (
        1.75  # ours: stale ground counts to the edge of the terrain map; seed 001: 1.3
    )
    eye_m: float = 0.38  # ours: height of the tilted camera, DARwIn-OP
    unwatched_s: float = 2.0  # ours: the way not looked at for so long has its whole worth
    urgency_max: float = 4.0  # ours: and up to so many times that later
    way_floor: float = 0.3  # ours: psi_way counts at least this, or who is crowded walks blind
    seek_s: float = 1.0  # ours: a mover unseen for so long is worth a look ...
    near_m: float = 1.2  # ours: ... wholly if it is this near ...
    far_m: float = 2.2  # ours: ... and not at all beyond this
    receding: float = 0.5  # ours: share of that for a mover that goes away
    moving_share: float = (
        0.3  # ours, as the guard: less probable movers need no look of their own ...
    )
    young_s: float = (
        3.0  # ours: ... unless they were followed for less than this: nobody can tell yet
    )
    young_share: float = 0.4  # ours: a look at such a thing is worth so much of one at a mover
    seek_max: float = 3.0  # ours: worth of the most overdue look, in those of one that is due
    new_looks: int = 2  # ours: so often a thing without a track is looked at again, to get one
    new_apart_m: float = 0.25  # ours: nearer than this to a track, or to one before, it is the same
    turned_back_s: float = 3.0  # ours: unseen for longer, it may as well have turned back
    edge_deg: float = 12.0  # ours: kept off the sides of the view, where things are cut in two
    tag_across_deg: float = 90.0  # seed 000: the colour camera, which sees the landmarks
    tag_reach_m: float = 3.5  # ours: beyond it a tag is too small
    tag_range_per_m: float = (
        0.0035  # ours: deviation of a range to a tag, by its square, as claimed
    )
    tag_bearing_deg: float = 0.4  # ours: head play, roll of the stride, as claimed
    tag_doubt: float = 0.4  # ours: what a look in vain leaves of the trust that a tag can be seen
    tag_forget_s: float = 10.0  # ours: how soon that is forgotten: from elsewhere it may be seen

    def __post_init__(self) -> None:
        for name in ("eye_m", "unwatched_s", "seek_s", "tag_reach_m", "tag_forget_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"gaze: {name}={value} must be positive and finite")
        if not 0.0 < self.near_m < self.far_m:
            raise ConfigError(
                f"gaze: near_m={self.near_m} must be positive and below far_m={self.far_m}"
            )
        if not 0.0 <= self.edge_deg < self.map.across_deg:
            raise ConfigError(
                f"gaze: edge_deg={self.edge_deg} must lie in [0, across_deg={self.map.across_deg})"
            )


@dataclass(frozen=True)
class Known:
    """What the cycle knows that a look can better.

    Args:
        pose: Over (x, y, yaw), world frame, m and rad.
        grid: The terrain map; None before the first view.
        confidence: Its freshness.
        landmarks: Known beforehand, world frame.
        sightings: Of this frame.
        clusters: Things seen in this frame, body frame.
    """

    pose: Gaussian
    grid: EgocentricGrid | None = None
    confidence: ConfidenceLayer | None = None
    landmarks: Sequence[Landmark] = ()
    sightings: Sequence[Sighting] = ()
    clusters: Sequence[Cluster] = ()


@dataclass(frozen=True)
class Attention:
    """The evaluations of this moment, and the gaze map they make.

    Args:
        total: GM, [pan, tilt].
        psi_map, psi_self, psi_way: In [0, 1]; psi_way before its urgency.
        psi_obstacles: Track to the greater of psi_ob and seeking, in [0, 1].
    """

    total: Float[np.ndarray, "rows columns"]
    psi_map: float
    psi_self: float
    psi_way: float
    psi_obstacles: dict[int, float]


class Attentive:
    """Lays the map anew for every look; remembers what looks showed, and which were in vain."""

    def __init__(self, config: AttentionConfig) -> None:
        self.config = config
        gaze = config.map
        self._narrow = replace(gaze, across_deg=gaze.across_deg - config.edge_deg)
        self._wide = replace(
            gaze, across_deg=config.tag_across_deg, down_deg=config.tag_across_deg, literal=False
        )
        self._way_s = -math.inf  # when the way was last looked at
        self._sought_s: dict[int, float] = {}  # by track: when a look went to where it may be
        self._trust: dict[int, float] = {}  # by landmark: that a look there shows it
        self._met: list[
            tuple[np.ndarray, float]
        ] = []  # things without a track that got a look, when
        self._stamp_s = 0.0

    def weigh(
        self,
        stamp_s: float,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: Known,
        present: GazeCommand,
    ) -> Attention:
        """The gaze map of now.

        Args:
            stamp_s: Now, in the clock of `Obstacle.seen_s`.
            via: The point walked to, world frame, m.
            obstacles: Tracks, world frame.
            known: Pose, map, landmarks.
            present: Where the head has looked until now.
        """
        gaze, pose = self.config.map, known.pose
        self._learn_tags(stamp_s, known, present)
        psi_way = self._psi_way(pose, obstacles)
        value = gaze.way_weight * max(psi_way, self.config.way_floor) * self._urgency(stamp_s)
        places, values = [self._way(pose, via)[None]], [np.array([value])]
        psi_movers = {}
        for mover in self._movers(obstacles):
            psi = self._psi_mover(stamp_s, mover, pose)
            places.append(self._may_be(stamp_s, mover, pose))
            each = gaze.obstacle_weight * psi / len(places[-1])
            values.append(np.full(len(places[-1]), each))
            psi_movers[mover.track] = psi
        new, worth = self._newcomers(stamp_s, known, obstacles)
        places, values = [*places, new], [*values, gaze.obstacle_weight * worth]
        total = shown(np.concatenate(places), np.concatenate(values), self._narrow)
        stale, staleness = self._stale(known)
        psi_map = float(staleness.mean()) if len(stale) else 0.0
        if psi_map > 0.0:
            total += gaze.map_weight * psi_map * _best_is_one(shown(stale, staleness, gaze))
        psi_self = evaluations.of_self(pose.covariance, gaze.evaluation)
        tags, due = self._tags(known)
        if len(tags):
            total += gaze.self_weight * psi_self * _best_is_one(shown(tags, due, self._wide))
        return Attention(total, psi_map, psi_self, psi_way, psi_movers)

    def decided(
        self,
        stamp_s: float,
        gaze: GazeCommand,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        pose: Gaussian,
    ) -> None:
        """Take down what the look that was decided on is going to show."""
        if in_view(self._way(pose, via)[None], gaze, self._narrow)[0]:
            self._way_s = stamp_s
        for mover in self._movers(obstacles):
            if in_view(self._may_be(stamp_s, mover, pose), gaze, self._narrow).any():
                self._sought_s[mover.track] = stamp_s

    def _movers(self, obstacles: Sequence[Obstacle]) -> list[Obstacle]:
        config = self.config
        return [
            o
            for o in obstacles
            if o.moving >= config.moving_share or o.seen_s - o.since_s < config.young_s
        ]

    def _from_camera(
        self, pose: Gaussian, places: Float[np.ndarray, "n 2"], height_m: float = 0.0
    ) -> Float[np.ndarray, "n 3"]:
        """World places at a height, from the camera, body axes."""
        return np.column_stack(
            [_in_body(pose, places), np.full(len(places), height_m - self.config.eye_m)]
        )

    def _way(self, pose: Gaussian, via: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3"]:
        """A point on the floor where the next steps go: towards the via point, within a metre."""
        way = self._from_camera(pose, via[None])[0]
        way[:2] *= min(1.0, WAY_M / max(float(np.hypot(way[0], way[1])), 1e-9))
        return way

    def _urgency(self, stamp_s: float) -> float:
        """Of the way: square of the time since it was looked at, by `unwatched_s`."""
        alone = min((stamp_s - self._way_s) / self.config.unwatched_s, 1e3)
        return min(alone**2, self.config.urgency_max)

    def _psi_way(self, pose: Gaussian, obstacles: Sequence[Obstacle]) -> float:
        places = _in_body(pose, np.array([o.position for o in obstacles]).reshape(-1, 2))
        radii = np.array([o.radius_m for o in obstacles]) + BODY_M
        ahead = places[:, 0] > 0.0
        return evaluations.of_way(places[ahead], radii[ahead], self.config.map.evaluation)

    def _stale(self, known: Known) -> tuple[np.ndarray, np.ndarray]:
        """Sample points out of view, from the camera, and how stale each is, in [0, 1]."""
        if known.grid is None or known.confidence is None:
            return np.zeros((0, 3)), np.zeros(0)
        points, confidence = sample_region(
            known.grid, known.confidence, known.pose, self.config.map, self.config.ground_m
        )
        points, confidence = points[::EVERY], confidence[::EVERY]
        unseen = confidence < 1.0
        lost = (1.0 - confidence[unseen]) / max(1.0 - known.confidence.config.stale_below, 1e-6)
        return self._from_camera(known.pose, points[unseen]), np.minimum(lost, 1.0) ** 2

    def _psi_mover(self, stamp_s: float, mover: Obstacle, pose: Gaussian) -> float:
        """The greater of psi_ob and of how much a look for it is due."""
        config = self.config
        offset = mover.position - pose.mean[:2]
        away = float(np.hypot(*offset))
        psi_ob = float(
            evaluations.of_obstacles(
                offset[None],
                mover.velocity[None],
                mover.state.covariance[None, :2, :2],
                config.map.evaluation,
            )[0]
        )
        alone = min(stamp_s - mover.seen_s, stamp_s - self._sought_s.get(mover.track, -math.inf))
        worth = self._nearness(away) * min((alone / config.seek_s) ** 2, config.seek_max)
        if float(offset @ mover.velocity) >= 0.0:
            worth *= config.receding
        if mover.moving < config.moving_share:
            worth *= config.young_share
        return max(psi_ob, worth)

    def _may_be(self, stamp_s: float, mover: Obstacle, pose: Gaussian) -> Float[np.ndarray, "n 3"]:
        """Where on the floor it may be by now: gone straight on, or turned back when last seen."""
        unseen = stamp_s - mover.seen_s
        places = [mover.position]
        if unseen >= self.config.turned_back_s:
            places.append(mover.position - 2.0 * mover.velocity * unseen)
        return self._from_camera(pose, np.array(places))

    def _newcomers(
        self, stamp_s: float, known: Known, obstacles: Sequence[Obstacle]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """Things of this frame that have no track yet, from the camera; and how much each is due.

        Two sightings make no track, and one look is two frames: who looks away then loses it again. Of what is
        cut off by the edge of the view only the near counts: far off it is mostly furniture.
        """
        config = self.config
        self._met = [(place, when) for place, when in self._met if stamp_s - when < MET_S]
        taken = [o.position for o in obstacles]
        places, due = [], []
        for cluster in known.clusters:
            away = float(np.hypot(*cluster.centre))
            far = config.far_m if cluster.whole else config.near_m
            if cluster.radius_m > LARGEST_M or away > far:
                continue
            place = _in_world(known.pose, cluster.centre)
            before = sum(np.hypot(*(place - met)) < config.new_apart_m for met, _ in self._met)
            near = any(np.hypot(*(place - other)) < config.new_apart_m for other in taken)
            if near or before >= config.new_looks:
                continue
            self._met.append((place, stamp_s))
            places.append([*cluster.centre, -config.eye_m])
            due.append(self._nearness(away))
        return np.array(places).reshape(-1, 3), np.array(due).reshape(-1)

    def _nearness(self, away_m: float) -> float:
        near, far = self.config.near_m, self.config.far_m
        return min(max((far - away_m) / (far - near), 0.0), 1.0)

    def _tags(self, known: Known) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """Landmarks within reach, from the camera, and what a sighting of each would gain."""
        config, pose = self.config, known.pose
        places = np.array([mark.position for mark in known.landmarks]).reshape(-1, 3)
        trust = np.array([self._trust.get(mark.identity, 1.0) for mark in known.landmarks])
        body = np.column_stack([_in_body(pose, places[:, :2]), places[:, 2] - config.eye_m])
        near = np.hypot(body[:, 0], body[:, 1]) <= config.tag_reach_m
        due = gains(
            places[near, :2] - pose.mean[:2],
            pose.covariance,
            config.tag_range_per_m,
            math.radians(config.tag_bearing_deg),
        )
        return body[near], trust[near] * due

    def _learn_tags(self, stamp_s: float, known: Known, present: GazeCommand) -> None:
        """A landmark in view that was not sighted is hidden or aslant from here: trust it less for a while."""
        config = self.config
        keep = math.exp(-(stamp_s - self._stamp_s) / config.tag_forget_s)
        self._stamp_s = stamp_s
        self._trust = {tag: 1.0 - (1.0 - trust) * keep for tag, trust in self._trust.items()}
        if not known.landmarks:
            return
        seen = {sighting.identity for sighting in known.sightings}
        places = np.array([mark.position for mark in known.landmarks])
        body = np.column_stack([_in_body(known.pose, places[:, :2]), places[:, 2] - config.eye_m])
        expected = in_view(body, present, self._wide)
        expected &= np.hypot(body[:, 0], body[:, 1]) <= config.tag_reach_m
        for mark, looked in zip(known.landmarks, expected, strict=True):
            if mark.identity in seen:
                self._trust[mark.identity] = 1.0
            elif looked:
                self._trust[mark.identity] = config.tag_doubt * self._trust.get(mark.identity, 1.0)


def sample_region(
    grid: EgocentricGrid,
    confidence: ConfidenceLayer,
    pose: Gaussian,
    config: GazeMapConfig,
    farthest_m: float | None = None,
) -> tuple[Float[np.ndarray, "n 2"], Float32[np.ndarray, "n"]]:
    """R_s: middles of the cells between d_nm and d_fm that the neck can turn to, and their confidence.

    Args:
        grid: The terrain map; its window should reach d_fm round the robot.
        confidence: Of its cells.
        pose: Over (x, y, yaw), world frame.
        config: d_nm, d_fm and the reach of the neck.
        farthest_m: In place of d_fm.

    Returns:
        World frame, m; and C in [0, 1].

    Source: seed 001, section 3, eq. (1).
    """
    limits = config.evaluation
    centres = grid.centres().reshape(-1, 2)
    x, y = _in_body(pose, centres).T
    away = np.hypot(x, y)
    inside = (away >= limits.nearest_m) & (away <= (farthest_m or limits.farthest_m))
    inside &= np.abs(np.arctan2(y, x)) <= math.radians(config.pan_deg)
    return centres[inside], confidence.values.ravel()[inside]


def _in_body(pose: Gaussian, places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    c, s = math.cos(pose.mean[2]), math.sin(pose.mean[2])
    return (places - pose.mean[:2]) @ np.array([[c, -s], [s, c]])


def _in_world(pose: Gaussian, place: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    c, s = math.cos(pose.mean[2]), math.sin(pose.mean[2])
    return pose.mean[:2] + np.array([[c, -s], [s, c]]) @ place


def _best_is_one(seen: np.ndarray) -> np.ndarray:
    most = float(seen.max())
    return seen / most if most > 0.0 else seen
