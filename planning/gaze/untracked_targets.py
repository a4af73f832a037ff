"""Untracked clusters as gaze targets, with their priority.

A track takes three sightings of a whole cluster, and one gaze lasts two frames, so a single look often creates none.
A cluster cut off by the edge of the view gets no track until the head turns towards it, and the ground beside the
path stays unknown there. The gaze therefore returns to such clusters while they are near, with lower priority
after looks that created no track.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.obstacles.clustering import Cluster
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from ..commands import GazeCommand
from .priority import FAR_M, NEAR_M, SEEK_MAX, nearness
from .sampling import from_camera, in_world
from .selection import GazeMapConfig, in_view

LARGEST_M = 0.35  # as the tracker: larger clusters are furniture
CLOSE_M = 0.7  # ours: a cluster this near has the priority of the most overdue track
APART_M = 0.25  # ours: nearer than this to a track, or to an earlier cluster, it is the same
AGAIN_SHARE = 0.5  # ours: factor of the priority for each earlier look ...
FORGET_S = 8.0  # ours: ... within this time
HIDDEN_M = 0.10  # ours: extent that may be hidden beyond the edge of the view


class UntrackedTargets:
    """Clusters without a track, and the looks that they got."""

    def __init__(self, eye_m: float) -> None:
        self._eye_m = eye_m
        self._places: list[np.ndarray] = []  # of the present clusters, world frame
        self._points: list[np.ndarray] = []  # points that looks should show, world frame
        self._owner: list[int] = []  # cluster of each point
        self._looks: list[tuple[np.ndarray, float]] = []  # position and stamp of earlier looks

    def weigh(
        self,
        stamp_s: float,
        pose: Gaussian,
        clusters: Sequence[Cluster],
        obstacles: Sequence[Obstacle],
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """Points that looks should show, from the camera in body axes, m, and their priorities.

        A whole cluster has one point. A cut off one has three, its middle and its possible ends, and counts only
        nearby, since farther away it is mostly furniture.

        Args:
            stamp_s: Present time.
            pose: Over (x, y, yaw), world frame.
            clusters: Of this frame, body frame.
            obstacles: Tracks, world frame.
        """
        self._looks = [(at, when) for at, when in self._looks if stamp_s - when < FORGET_S]
        self._places, self._points, self._owner = [], [], []
        tracks = [obstacle.position for obstacle in obstacles]
        points: list[list[float]] = []
        worth: list[float] = []
        for cluster in clusters:
            away = float(np.hypot(*cluster.centre))
            far = FAR_M if cluster.whole else NEAR_M
            if cluster.radius_m > LARGEST_M or away > far:
                continue
            place = in_world(pose, cluster.centre)
            if any(np.hypot(*(place - track)) < APART_M for track in tracks):
                continue
            before = sum(np.hypot(*(place - look)) < APART_M for look, _ in self._looks)
            due = SEEK_MAX if away < CLOSE_M else nearness(away)
            due *= AGAIN_SHARE**before
            shown = _extent(cluster, away)
            self._owner += [len(self._places)] * len(shown)
            self._points += [in_world(pose, at) for at in shown]
            self._places.append(place)
            points += [[*at, -self._eye_m] for at in shown]
            worth += [due / len(shown)] * len(shown)
        return np.array(points).reshape(-1, 3), np.array(worth).reshape(-1)

    def looked(
        self, stamp_s: float, gaze: GazeCommand, pose: Gaussian, view: GazeMapConfig
    ) -> None:
        """Record the clusters that the chosen gaze shows, also in part.

        A cluster partly beyond the range of the neck is never shown whole; without this it would hold the gaze.
        """
        there = from_camera(pose, np.reshape(self._points, (-1, 2)), self._eye_m)
        shown = in_view(there, gaze, view)
        met = sorted({owner for owner, seen in zip(self._owner, shown, strict=True) if seen})
        self._looks += [(self._places[k], stamp_s) for k in met]


def _extent(cluster: Cluster, away: float) -> list[np.ndarray]:
    """The middle of a cluster, and if it is cut off its possible ends across the line of sight, body frame, m."""
    if cluster.whole:
        return [cluster.centre]
    x, y = (cluster.centre / max(away, 1e-9)).tolist()
    across = (cluster.radius_m + HIDDEN_M) * np.array([-y, x])
    return [cluster.centre, cluster.centre + across, cluster.centre - across]
