"""Things that no track follows yet: where a look shows each whole, and how much that look is due.

A track takes three sightings of a whole thing, and one look is two frames: who looks away then loses it again.
What the edge of the view cuts off gets no track at all until the head has turned towards it, and whatever
stands or goes there is blind ground beside the way. So such a thing is looked at with what may hide beyond
the cut, again and again while it is near, less eagerly after looks that brought nothing.

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
from .attention_settings import AttentionConfig
from .sampling import from_camera, in_world
from .selection import GazeMapConfig, in_view

LARGEST_M = 0.35  # as the tracker: larger is furniture


class UntrackedTargets:
    """Remembers which things without a track got a look."""

    def __init__(self, config: AttentionConfig, eye_m: float) -> None:
        self.config, self._eye_m = config, eye_m
        self._places: list[np.ndarray] = []  # of this moment's things, world frame
        self._points: list[np.ndarray] = []  # of them, that looks should show, world frame
        self._whose: list[int] = []  # which thing each point is of
        self._met: list[tuple[np.ndarray, float]] = []  # what got a look, when

    def weigh(
        self,
        stamp_s: float,
        pose: Gaussian,
        clusters: Sequence[Cluster],
        obstacles: Sequence[Obstacle],
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """Points that looks should show, and what each is worth; from the camera, body axes, m.

        A whole thing has one point, one that is cut off three: its middle, and how far it may reach on either
        side. Of the cut off only the near count: far off it is mostly furniture.

        Args:
            stamp_s: Now.
            pose: Over (x, y, yaw), world frame.
            clusters: Things seen in this frame, body frame.
            obstacles: Tracks, world frame.
        """
        config = self.config
        self._met = [(at, when) for at, when in self._met if stamp_s - when < config.met_s]
        self._places, self._points, self._whose = [], [], []
        tracks = [obstacle.position for obstacle in obstacles]
        points: list[list[float]] = []
        worth: list[float] = []
        for cluster in clusters:
            away = float(np.hypot(*cluster.centre))
            far = config.far_m if cluster.whole else config.near_m
            if cluster.radius_m > LARGEST_M or away > far:
                continue
            place = in_world(pose, cluster.centre)
            if any(np.hypot(*(place - track)) < config.new_apart_m for track in tracks):
                continue
            before = sum(np.hypot(*(place - met)) < config.new_apart_m for met, _ in self._met)
            due = config.seek_max if away < config.close_m else config.nearness(away)
            due *= config.again_share**before
            shown = _extent(cluster, away, config.hidden_m)
            self._whose += [len(self._places)] * len(shown)
            self._points += [in_world(pose, at) for at in shown]
            self._places.append(place)
            points += [[*at, -self._eye_m] for at in shown]
            worth += [due / len(shown)] * len(shown)
        return np.array(points).reshape(-1, 3), np.array(worth).reshape(-1)

    def looked(
        self, stamp_s: float, gaze: GazeCommand, pose: Gaussian, view: GazeMapConfig
    ) -> None:
        """Take down which of them the look that was decided on is going to show, be it in part.

        What lies beyond the reach of the neck never shows more: who waited for that would stare for ever.
        """
        there = from_camera(pose, np.reshape(self._points, (-1, 2)), self._eye_m)
        shown = in_view(there, gaze, view)
        met = sorted({whose for whose, seen in zip(self._whose, shown, strict=True) if seen})
        self._met += [(self._places[k], stamp_s) for k in met]


def _extent(cluster: Cluster, away: float, hidden_m: float) -> list[np.ndarray]:
    """Its middle, and if it is cut off how far it may reach across the line of sight, body frame, m."""
    if cluster.whole:
        return [cluster.centre]
    x, y = (cluster.centre / max(away, 1e-9)).tolist()
    across = (cluster.radius_m + hidden_m) * np.array([-y, x])
    return [cluster.centre, cluster.centre + across, cluster.centre - across]
