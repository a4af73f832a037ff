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
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid
from perception.obstacles.clustering import Cluster
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.robot_model import DARWIN_OP, RobotModel

from ..commands import GazeCommand
from ..world_model import WorldModel
from . import evaluations
from .attention_settings import AttentionConfig as AttentionConfig
from .sampling import from_camera, in_body, region
from .sampling import sample_region as sample_region
from .selection import in_view, shown
from .tag_gain import gains
from .untracked_targets import UntrackedTargets

EVERY = 3  # of the sample points is laid over the map: a fifth of the view holds dozens still
WAY_M = 1.0  # so far ahead the floor of the next steps lies


@dataclass(frozen=True)
class GazeContext:
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

    @classmethod
    def of(cls, world: WorldModel) -> GazeContext:
        """From a world model whose pose is known."""
        assert world.pose is not None
        estimate = world.estimate
        return cls(
            world.pose,
            world.grid,
            world.confidence,
            world.landmarks,
            estimate.sightings,
            estimate.clusters,
        )


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


class AttentionModel:
    """Lays the map anew for every look; remembers what looks showed, and which were in vain."""

    def __init__(self, config: AttentionConfig, robot: RobotModel = DARWIN_OP) -> None:
        gaze = replace(config.map, head=robot.head)
        self.config, self._robot = replace(config, map=gaze), robot
        self._narrow = replace(gaze, across_deg=gaze.across_deg - config.edge_deg)
        self._wide = replace(
            gaze, across_deg=config.tag_across_deg, down_deg=config.tag_across_deg, literal=False
        )
        self._way_s = -math.inf  # when the way was last looked at
        self._sought_s: dict[int, float] = {}  # by track: when a look went to where it may be
        self._trust: dict[int, float] = {}  # by landmark: that a look there shows it
        self._newcomers = UntrackedTargets(config, robot.eye_m)
        self._stamp_s = 0.0

    def weigh(
        self,
        stamp_s: float,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: GazeContext,
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
        movers = self._movers(obstacles)
        psi = self._psi_movers(stamp_s, movers, pose)
        there, whose = self._may_be(stamp_s, movers, pose)
        each = (gaze.obstacle_weight * psi / np.bincount(whose, minlength=len(movers)))[whose]
        new, worth = self._newcomers.weigh(stamp_s, pose, known.clusters, obstacles)
        places = np.concatenate([self._way(pose, via)[None], there, new])
        values = np.concatenate([[value], each, gaze.obstacle_weight * worth])
        total = shown(places, values, self._narrow)
        stale, staleness = self._stale(known)
        psi_map = float(staleness.mean()) if len(stale) else 0.0
        if psi_map > 0.0:
            total += gaze.map_weight * psi_map * _best_is_one(shown(stale, staleness, gaze))
        psi_self = evaluations.of_self(pose.covariance, gaze.evaluation)
        tags, due = self._tags(known)
        if len(tags):
            total += gaze.self_weight * psi_self * _best_is_one(shown(tags, due, self._wide))
        psi_movers = dict(zip((mover.track for mover in movers), psi.tolist(), strict=True))
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
        self._newcomers.looked(stamp_s, gaze, pose, self._narrow)
        movers = self._movers(obstacles)
        there, whose = self._may_be(stamp_s, movers, pose)
        for k in whose[in_view(there, gaze, self._narrow)]:
            self._sought_s[movers[k].track] = stamp_s

    def _movers(self, obstacles: Sequence[Obstacle]) -> list[Obstacle]:
        config = self.config
        return [o for o in obstacles if o.moving >= MOVING or o.seen_s - o.since_s < config.young_s]

    def _way(self, pose: Gaussian, via: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3"]:
        """A point on the floor where the next steps go: towards the via point, within a metre."""
        way = from_camera(pose, via[None], self._robot.eye_m)[0]
        way[:2] *= min(1.0, WAY_M / max(math.hypot(way[0], way[1]), 1e-9))
        return way

    def _urgency(self, stamp_s: float) -> float:
        """Of the way: square of the time since it was looked at, by `unwatched_s`."""
        alone = min((stamp_s - self._way_s) / self.config.unwatched_s, 1e3)
        return min(alone**2, self.config.urgency_max)

    def _psi_way(self, pose: Gaussian, obstacles: Sequence[Obstacle]) -> float:
        places = in_body(pose, np.array([o.position for o in obstacles]).reshape(-1, 2))
        radii = np.array([o.radius_m for o in obstacles]) + self._robot.radius_m
        ahead = places[:, 0] > 0.0
        return evaluations.of_way(places[ahead], radii[ahead], self.config.map.evaluation)

    def _stale(self, known: GazeContext) -> tuple[np.ndarray, np.ndarray]:
        """Sample points out of view, from the camera, and how stale each is, in [0, 1]."""
        if known.grid is None or known.confidence is None:
            return np.zeros((0, 3)), np.zeros(0)
        grid, fresh, config = known.grid, known.confidence, self.config
        cells = region(grid, known.pose, config.map, config.ground_m)[::EVERY]
        confidence = fresh.values.ravel()[cells]
        unseen = confidence < 1.0
        lost = (1.0 - confidence[unseen]) / max(1.0 - fresh.config.stale_below, 1e-6)
        points = grid.centres().reshape(-1, 2)[cells[unseen]]
        return from_camera(known.pose, points, self._robot.eye_m), np.minimum(lost, 1.0) ** 2

    def _psi_movers(
        self, stamp_s: float, movers: Sequence[Obstacle], pose: Gaussian
    ) -> Float[np.ndarray, "n"]:
        """Of each mover the greater of psi_ob and of how much a look for it is due."""
        config = self.config
        offsets = np.array([mover.position for mover in movers]).reshape(-1, 2) - pose.mean[:2]
        velocities = np.array([mover.velocity for mover in movers]).reshape(-1, 2)
        covariances = [mover.state.covariance[:2, :2] for mover in movers]
        psi_ob = evaluations.of_obstacles(
            offsets, velocities, np.array(covariances).reshape(-1, 2, 2), config.map.evaluation
        )
        away = np.hypot(offsets[:, 0], offsets[:, 1]).tolist()
        receding = (np.sum(offsets * velocities, axis=1) >= 0.0).tolist()
        worth = np.empty(len(movers))
        for k, mover in enumerate(movers):
            sought_s = self._sought_s.get(mover.track, -math.inf)
            alone = stamp_s - max(mover.seen_s, sought_s)
            worth[k] = self.config.nearness(away[k]) * min(
                (alone / config.seek_s) ** 2, config.seek_max
            )
            worth[k] *= config.receding if receding[k] else 1.0
            worth[k] *= config.young_share if mover.moving < MOVING else 1.0
        return np.maximum(psi_ob, worth)

    def _may_be(
        self, stamp_s: float, movers: Sequence[Obstacle], pose: Gaussian
    ) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
        """Where on the floor each may be by now, from the camera, and whose place that is.

        Gone straight on, or turned back when last seen.
        """
        places, whose = [mover.position for mover in movers], list(range(len(movers)))
        for k, mover in enumerate(movers):
            unseen = stamp_s - mover.seen_s
            if unseen >= self.config.turned_back_s:
                places.append(mover.position - 2.0 * mover.velocity * unseen)
                whose.append(k)
        there = from_camera(pose, np.array(places).reshape(-1, 2), self._robot.eye_m)
        return there, np.array(whose, np.int64)

    def _tags(self, known: GazeContext) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """Landmarks within reach, from the camera, and what a sighting of each would gain."""
        config, pose = self.config, known.pose
        if not known.landmarks:
            return np.zeros((0, 3)), np.zeros(0)
        places = np.array([mark.position for mark in known.landmarks])
        trust = np.array([self._trust.get(mark.identity, 1.0) for mark in known.landmarks])
        body = from_camera(pose, places[:, :2], self._robot.eye_m, places[:, 2])
        near = np.hypot(body[:, 0], body[:, 1]) <= config.tag_reach_m
        due = gains(
            places[near, :2] - pose.mean[:2],
            pose.covariance,
            config.tag_range_per_m,
            math.radians(config.tag_bearing_deg),
        )
        return body[near], trust[near] * due

    def _learn_tags(self, stamp_s: float, known: GazeContext, present: GazeCommand) -> None:
        """A landmark in view that was not sighted is hidden or aslant from here: trust it less for a while."""
        config = self.config
        keep = math.exp(-(stamp_s - self._stamp_s) / config.tag_forget_s)
        self._stamp_s = stamp_s
        self._trust = {tag: 1.0 - (1.0 - trust) * keep for tag, trust in self._trust.items()}
        if not known.landmarks:
            return
        seen = {sighting.identity for sighting in known.sightings}
        places = np.array([mark.position for mark in known.landmarks])
        body = from_camera(known.pose, places[:, :2], self._robot.eye_m, places[:, 2])
        expected = in_view(body, present, self._wide)
        expected &= np.hypot(body[:, 0], body[:, 1]) <= config.tag_reach_m
        for mark, looked in zip(known.landmarks, expected, strict=True):
            if mark.identity in seen:
                self._trust[mark.identity] = 1.0
            elif looked:
                self._trust[mark.identity] = config.tag_doubt * self._trust.get(mark.identity, 1.0)


def _best_is_one(seen: np.ndarray) -> np.ndarray:
    most = float(seen.max())
    return seen / most if most > 0.0 else seen
