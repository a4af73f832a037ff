"""The gaze map of the present moment: the four evaluations from live covariances, over pan and tilt.

Three reasons to look are ours. A moving obstacle out of sight gains priority with time and nearness, at both positions
where it may be by now; in our walks most contacts are with obstacles unseen for two seconds. The path ahead becomes
urgent while the gaze is elsewhere. Directions from which something may have come since the last look (`arrivals`) count
also behind the range of the neck, where the body must turn. A look reduces its own reason at once: stale ground by its confidence, the path
by the time since, landmarks by the reduction of the pose covariance.

Source: Yoo 2010 (seed 001), section 3; seeking, urgency and the gain of landmarks are ours.
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
from . import arrivals, evaluations
from .landmark_gain import gains
from .priority import SEEK_MAX, nearness
from .sampling import from_camera, in_body, region
from .sampling import sample_region as sample_region
from .selection import GazeMapConfig, first_image_s, in_view, shown
from .untracked_targets import UntrackedTargets

# all ours, from walks in simulation
EVERY = 3  # every third sample point is used; a fifth of the view still holds dozens
WAY_M = 1.0  # distance of the floor of the next steps
GROUND_M = 1.75  # stale ground counts up to the edge of the terrain map; seed 001: 1.3
UNWATCHED_S = 2.0  # ours: three steps; time without a look after which the path has its full weight
URGENCY_MAX = 4.0  # largest factor of that weight
WAY_FLOOR = 0.3  # least psi_way: in a crowd the path still counts
SEEK_S = 1.0  # ours: two steps, rounded; time out of sight after which a look for a moving obstacle is due
RECEDING = 0.5  # factor for a moving obstacle that goes away
YOUNG_S = 3.0  # a track followed for less than this may still prove to move
YOUNG_SHARE = 0.4  # factor for such a track
TURN_MOST_S = 4.0  # ours: six steps, from the neck's end to straight behind; longest turn of the body for a look
TURNED_BACK_S = 3.0  # out of sight for longer, an obstacle may have reversed
EDGE_DEG = 12.0  # margin to the sides of the view, where clusters are cut off
TAG_VIEW_DEG = 90.0  # seed 000: field of view of the colour camera, which sees the landmarks
TAG_REACH_M = 3.5  # farther landmarks are too small
TAG_RANGE_PER_M = 0.0035  # standard deviation of a range to a landmark, divided by its square
TAG_BEARING_RAD = math.radians(0.4)
"""Standard deviation of a bearing: play of the head, roll of the gait."""
TAG_DOUBT = 0.4  # factor of the trust in a landmark after a look without a sighting
TAG_FORGET_S = 10.0  # ours: a walk of some decimetres; time constant of the recovery of that trust


@dataclass(frozen=True)
class GazeContext:
    """Estimates that a look can improve.

    Args:
        pose: Over (x, y, yaw), world frame, m and rad.
        grid: The terrain map; None before the first view.
        confidence: Of its cells.
        landmarks: Known beforehand, world frame.
        sightings: Of this frame.
        clusters: Of this frame, body frame.
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
    """The present evaluations and their gaze map.

    Args:
        total: GM, [pan, tilt].
        psi_map, psi_self, psi_way: In [0, 1]; psi_way without its urgency.
        psi_obstacles: By track, the larger of psi_ob and the priority of a look for it.
        turned: Worth of what a turn of the body to the left, and to the right, brings within the range of the neck, by
            the time that it takes.
    """

    total: Float[np.ndarray, "rows columns"]
    psi_map: float
    psi_self: float
    psi_way: float
    psi_obstacles: dict[int, float]
    turned: tuple[float, float]


class AttentionModel:
    """Computes the gaze map for every look; remembers what earlier looks showed."""

    def __init__(self, config: GazeMapConfig, robot: RobotModel = DARWIN_OP) -> None:
        gaze = replace(config, head=robot.head)
        self.config, self._robot = gaze, robot
        self._narrow = replace(gaze, across_deg=gaze.across_deg - EDGE_DEG)
        self._wide = replace(gaze, across_deg=TAG_VIEW_DEG, down_deg=TAG_VIEW_DEG, literal=False)
        self._way_s = -math.inf  # stamp of the last look along the path
        self._sought_s: dict[int, float] = {}  # by track: stamp of the last look for it
        self._trust: dict[int, float] = {}  # by landmark: probability that a look shows it
        self._untracked = UntrackedTargets(robot.eye_m)
        self._stamp_s = 0.0
        self._fastest_mps = 0.0  # of the obstacles of this run

    def weigh(
        self,
        stamp_s: float,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: GazeContext,
        present: GazeCommand,
    ) -> Attention:
        """The present gaze map.

        Args:
            stamp_s: Present time, in the clock of `Obstacle.seen_s`.
            via: Via point, world frame, m.
            obstacles: Tracks, world frame.
            known: Pose, map, landmarks.
            present: Present direction of the head.
        """
        gaze, pose = self.config, known.pose
        self._learn_tags(stamp_s, known, present)
        psi_way = self._psi_way(pose, obstacles)
        value = gaze.way_weight * max(psi_way, WAY_FLOOR) * self._urgency(stamp_s)
        movers = self._movers(obstacles)
        psi = self._psi_movers(stamp_s, movers, pose)
        there, owner = self._may_be(stamp_s, movers, pose)
        each = (gaze.obstacle_weight * psi / np.bincount(owner, minlength=len(movers)))[owner]
        new, worth = self._untracked.weigh(stamp_s, pose, known.clusters, obstacles)
        ring, doubt = self._arrivals(obstacles, known)
        places = np.concatenate([self._way(pose, via)[None], there, new, ring])
        values = np.concatenate([[value], each, gaze.obstacle_weight * np.append(worth, doubt)])
        total = shown(places, values, self._narrow)
        stale, staleness = self._stale(known)
        psi_map = float(staleness.mean()) if len(stale) else 0.0
        if psi_map > 0.0:
            total += gaze.map_weight * psi_map * _normalised(shown(stale, staleness, gaze))
        psi_self = evaluations.of_self(pose.covariance, gaze.evaluation)
        tags, due = self._tags(known)
        if len(tags):
            total += gaze.self_weight * psi_self * _normalised(shown(tags, due, self._wide))
        psi_movers = dict(zip((mover.track for mover in movers), psi.tolist(), strict=True))
        turned = self._by_a_turn(places, values)
        return Attention(total, psi_map, psi_self, psi_way, psi_movers, turned)

    def decided(
        self,
        stamp_s: float,
        gaze: GazeCommand,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        pose: Gaussian,
    ) -> None:
        """Record what the chosen gaze will show."""
        if in_view(self._way(pose, via)[None], gaze, self._narrow)[0]:
            self._way_s = stamp_s
        self._untracked.looked(stamp_s, gaze, pose, self._narrow)
        movers = self._movers(obstacles)
        there, owner = self._may_be(stamp_s, movers, pose)
        for k in owner[in_view(there, gaze, self._narrow)]:
            self._sought_s[movers[k].track] = stamp_s

    def _arrivals(
        self, obstacles: Sequence[Obstacle], known: GazeContext
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """Places round the robot, relative to the camera, m, and the value of a look there, where an obstacle may have come."""
        self._fastest_mps = arrivals.fastest(self._fastest_mps, obstacles)
        if known.grid is None or known.confidence is None:
            return np.zeros((0, 3)), np.zeros(0)
        ring = np.column_stack([arrivals.RING, np.full(len(arrivals.RING), -self._robot.eye_m)])
        cruise = self._robot.gait.cruise_mps
        return ring, arrivals.doubts(
            known.pose, known.grid, known.confidence, self._fastest_mps, cruise
        )

    def _by_a_turn(
        self, places: Float[np.ndarray, "n 3"], values: Float[np.ndarray, "n"]
    ) -> tuple[float, float]:
        """Worth of the places beyond the neck's range, to the left and to the right, by the time of the turn."""
        bearing = np.arctan2(places[:, 1], places[:, 0])
        reach = math.radians(self._robot.head.pan_deg + self._narrow.across_deg / 2.0)
        gait, first_s = self._robot.gait, first_image_s(self._robot.gait)
        found = []
        for sense in (1.0, -1.0):
            turn_s = ((sense * bearing) % (2.0 * math.pi) - reach) * gait.step_s / gait.max_turn_rad
            beyond = (np.abs(bearing) > reach) & (turn_s < TURN_MOST_S)
            found.append(float(values[beyond] @ (first_s / (first_s + turn_s[beyond]))))
        return found[0], found[1]

    def _movers(self, obstacles: Sequence[Obstacle]) -> list[Obstacle]:
        return [o for o in obstacles if o.moving >= MOVING or o.seen_s - o.since_s < YOUNG_S]

    def _way(self, pose: Gaussian, via: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3"]:
        """A floor point on the next steps: towards the via point, within a metre, relative to the camera, m."""
        way = from_camera(pose, via[None], self._robot.eye_m)[0]
        way[:2] *= min(1.0, WAY_M / max(math.hypot(way[0], way[1]), 1e-9))
        return way

    def _urgency(self, stamp_s: float) -> float:
        """Factor of the path: square of the time without a look, divided by UNWATCHED_S."""
        alone = min((stamp_s - self._way_s) / UNWATCHED_S, 1e3)
        return min(alone**2, URGENCY_MAX)

    def _psi_way(self, pose: Gaussian, obstacles: Sequence[Obstacle]) -> float:
        places = in_body(pose, np.array([o.position for o in obstacles]).reshape(-1, 2))
        radii = np.array([o.radius_m for o in obstacles]) + self._robot.radius_m
        ahead = places[:, 0] > 0.0
        return evaluations.of_way(places[ahead], radii[ahead], self.config.evaluation)

    def _stale(self, known: GazeContext) -> tuple[np.ndarray, np.ndarray]:
        """Sample points out of view, relative to the camera, m, and their staleness in [0, 1]."""
        if known.grid is None or known.confidence is None:
            return np.zeros((0, 3)), np.zeros(0)
        grid, fresh = known.grid, known.confidence
        cells = region(grid, known.pose, self.config, GROUND_M)[::EVERY]
        confidence = fresh.values.ravel()[cells]
        unseen = confidence < 1.0
        lost = (1.0 - confidence[unseen]) / max(1.0 - fresh.config.stale_below, 1e-6)
        points = grid.centres().reshape(-1, 2)[cells[unseen]]
        return from_camera(known.pose, points, self._robot.eye_m), np.minimum(lost, 1.0) ** 2

    def _psi_movers(
        self, stamp_s: float, movers: Sequence[Obstacle], pose: Gaussian
    ) -> Float[np.ndarray, "n"]:
        """Of each moving obstacle the larger of psi_ob and the priority of a look for it."""
        offsets = np.array([mover.position for mover in movers]).reshape(-1, 2) - pose.mean[:2]
        velocities = np.array([mover.velocity for mover in movers]).reshape(-1, 2)
        covariances = [mover.state.covariance[:2, :2] for mover in movers]
        psi_ob = evaluations.of_obstacles(
            offsets, velocities, np.array(covariances).reshape(-1, 2, 2), self.config.evaluation
        )
        away = np.hypot(offsets[:, 0], offsets[:, 1]).tolist()
        receding = (np.sum(offsets * velocities, axis=1) >= 0.0).tolist()
        worth = np.empty(len(movers))
        for k, mover in enumerate(movers):
            sought_s = self._sought_s.get(mover.track, -math.inf)
            alone = stamp_s - max(mover.seen_s, sought_s)
            worth[k] = nearness(away[k]) * min((alone / SEEK_S) ** 2, SEEK_MAX)
            worth[k] *= RECEDING if receding[k] else 1.0
            worth[k] *= YOUNG_SHARE if mover.moving < MOVING else 1.0
        return np.maximum(psi_ob, worth)

    def _may_be(
        self, stamp_s: float, movers: Sequence[Obstacle], pose: Gaussian
    ) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
        """Possible present floor positions of each, relative to the camera, m, and the index of the obstacle.

        The obstacle went straight on, or reversed at the last sighting.
        """
        places, owner = [mover.position for mover in movers], list(range(len(movers)))
        for k, mover in enumerate(movers):
            unseen = stamp_s - mover.seen_s
            if unseen >= TURNED_BACK_S:
                places.append(mover.position - 2.0 * mover.velocity * unseen)
                owner.append(k)
        there = from_camera(pose, np.array(places).reshape(-1, 2), self._robot.eye_m)
        return there, np.array(owner, np.int64)

    def _tags(self, known: GazeContext) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """Landmarks within reach, relative to the camera, m, and the gain of a sighting of each."""
        pose = known.pose
        if not known.landmarks:
            return np.zeros((0, 3)), np.zeros(0)
        places = np.array([mark.position for mark in known.landmarks])
        trust = np.array([self._trust.get(mark.identity, 1.0) for mark in known.landmarks])
        body = from_camera(pose, places[:, :2], self._robot.eye_m, places[:, 2])
        near = np.hypot(body[:, 0], body[:, 1]) <= TAG_REACH_M
        due = gains(
            places[near, :2] - pose.mean[:2],
            pose.covariance,
            TAG_RANGE_PER_M,
            TAG_BEARING_RAD,
        )
        return body[near], trust[near] * due

    def _learn_tags(self, stamp_s: float, known: GazeContext, present: GazeCommand) -> None:
        """Reduce the trust in a landmark that is in view without a sighting: occluded, or viewed obliquely."""
        keep = math.exp(-(stamp_s - self._stamp_s) / TAG_FORGET_S)
        self._stamp_s = stamp_s
        self._trust = {tag: 1.0 - (1.0 - trust) * keep for tag, trust in self._trust.items()}
        if not known.landmarks:
            return
        seen = {sighting.identity for sighting in known.sightings}
        places = np.array([mark.position for mark in known.landmarks])
        body = from_camera(known.pose, places[:, :2], self._robot.eye_m, places[:, 2])
        expected = in_view(body, present, self._wide)
        expected &= np.hypot(body[:, 0], body[:, 1]) <= TAG_REACH_M
        for mark, looked in zip(known.landmarks, expected, strict=True):
            if mark.identity in seen:
                self._trust[mark.identity] = 1.0
            elif looked:
                self._trust[mark.identity] = TAG_DOUBT * self._trust.get(mark.identity, 1.0)


def _normalised(seen: np.ndarray) -> np.ndarray:
    """Scaled to a maximum of 1."""
    most = float(seen.max())
    return seen / most if most > 0.0 else seen
