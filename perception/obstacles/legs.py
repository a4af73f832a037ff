"""The two legs of a person: posts side by side that go on above the picture are one obstacle.

A camera low above the floor sees no more of somebody near than two posts that swing: each moves twice as fast as the
person, or stands. Where the picture shows their tops, they are objects of their own.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .clustering import Cluster

LEG_M = 0.09  # ours: largest radius of a leg
APART_M = 0.28  # ours: farthest legs; those of two people who walk side by side are farther from each other


def joined(clusters: Sequence[Cluster]) -> list[Cluster]:
    """The clusters, with every pair of legs as one.

    Two legs are a pair if each is the nearest leg of the other. The person's middle is between them.

    Args:
        clusters: Of one frame.
    """
    posts = [one for one in clusters if one.goes_on_above and one.radius_m <= LEG_M]
    if len(posts) < 2:
        return list(clusters)
    centres = np.array([one.centre for one in posts])
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    nearest = np.argmin(apart, axis=1)
    found = {id(one): one for one in clusters}
    for k, other in enumerate(nearest.tolist()):
        if k < other and nearest[other] == k and apart[k, other] <= APART_M:
            found[id(posts[k])] = _person(posts[k], posts[other])
            del found[id(posts[other])]
    return list(found.values())


def _person(one: Cluster, other: Cluster) -> Cluster:
    """The disc around two legs; if one of them is truncated, its centre is known to within its radius."""
    wide = math.dist(one.centre.tolist(), other.centre.tolist()) / 2.0
    unsure = 0.0 if one.placed and other.placed else max(one.radius_m, other.radius_m) / 2.0
    covariance = (one.covariance + other.covariance) / 4.0 + np.eye(2) * unsure**2
    return replace(
        one,
        centre=(one.centre + other.centre) / 2.0,
        covariance=covariance,
        radius_m=wide + max(one.radius_m, other.radius_m),
        height_m=max(one.height_m, other.height_m),
        points=one.points + other.points,
        whole=one.placed or other.placed,
        surface=np.concatenate([one.surface, other.surface]),
    )
