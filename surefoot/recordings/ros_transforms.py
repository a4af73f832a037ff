"""The tree of transforms of a bag, and the transform between any two of its frames.

A transform is interpolated between two stamps and unknown outside its time range.

Source: Foote, "tf: The transform library" (TePRA 2013).
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from perception.primitives.pose import Pose3

from .poses import between

_SLACK_S = 0.1
"""Ours: so shortly before the first or after the last stamp, the nearest pose is used."""


class Transforms:
    """Edges from parent to child, static or over time; a child may have several moving parents."""

    def __init__(self) -> None:
        self._static: dict[str, tuple[str, Pose3]] = {}
        self._moving: dict[str, dict[str, tuple[list[float], list[Pose3]]]] = {}
        self._chosen: dict[str, str] = {}

    def add(self, parent: str, child: str, stamp_s: float | None, transform: Any) -> None:
        """Add the pose of a child in its parent; a transform without a stamp is static."""
        q, t = transform.rotation, transform.translation
        quaternion = np.array([q.x, q.y, q.z, q.w], dtype=np.float64)
        length = float(np.linalg.norm(quaternion))
        if not (np.isfinite(length) and length > 0.5):
            return
        x, y, z, w = (float(v) for v in quaternion / length)
        pose = Pose3((float(t.x), float(t.y), float(t.z)), (x, y, z, w))
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if stamp_s is None:
            self._static[child] = (parent, pose)
            return
        stamps, poses = self._moving.setdefault(child, {}).setdefault(parent, ([], []))
        if not stamps or stamp_s > stamps[-1]:
            stamps.append(stamp_s)
            poses.append(pose)

    def first_leading_to(self, candidates: Sequence[str], child: str) -> str | None:
        """The first candidate from which a moving edge leads down to the child; None without one.

        From now on the shortest chain between them is used where a frame has several parents.
        """
        below = {child: ""}
        waiting = [child]
        for frame in waiting:
            new = [parent for parent in self._parents(frame) if parent not in below]
            below |= dict.fromkeys(new, frame)
            waiting += new
        for name in candidates:
            chain = [name] if name in below else []
            while chain and below[chain[-1]]:
                chain.append(below[chain[-1]])
            if any(one in self._moving for one in chain[1:]):
                self._chosen = {lower: upper for upper, lower in pairwise(chain)}
                return name
        return None

    def doubts(self) -> list[str]:
        """The frames of the chosen chain with several parents, in words."""
        return [
            f"{child} has {len(parents)} parents in tf ({', '.join(parents)}); that in {chosen} is used"
            for child, chosen in self._chosen.items()
            if len(parents := self._parents(child)) > 1
        ]

    def between(self, frame: str, other: str, stamp_s: float) -> Pose3 | None:
        """Pose of `other` in `frame` at a time; None if they are not connected then."""
        mine, theirs = self._chain(frame.lstrip("/")), self._chain(other.lstrip("/"))
        common = next((name for name in mine if name in theirs), None)
        if common is None:
            return None
        up, down = self._up(mine, common, stamp_s), self._up(theirs, common, stamp_s)
        if up is None or down is None:
            return None
        return up.inverse() @ down

    def _chain(self, frame: str) -> list[str]:
        """The frame and its ancestors."""
        chain = [frame]
        while (parent := self._parent(chain[-1])) is not None and parent not in chain:
            chain.append(parent)
        return chain

    def _parents(self, frame: str) -> list[str]:
        if frame in self._moving:
            return list(self._moving[frame])
        return [self._static[frame][0]] if frame in self._static else []

    def _parent(self, frame: str) -> str | None:
        return self._chosen.get(frame) or next(iter(self._parents(frame)), None)

    def _up(self, chain: Sequence[str], top: str, stamp_s: float) -> Pose3 | None:
        """Pose of the first frame of a chain in its member `top`."""
        pose = Pose3()
        for name in chain[: chain.index(top)]:
            edge = self._at(name, stamp_s)
            if edge is None:
                return None
            pose = edge @ pose
        return pose

    def _at(self, child: str, stamp_s: float) -> Pose3 | None:
        if child not in self._moving:
            return self._static[child][1]
        stamps, poses = self._moving[child][str(self._parent(child))]
        after = bisect.bisect_left(stamps, stamp_s)
        if after == 0 or after == len(stamps):
            nearest = min(after, len(stamps) - 1)
            return poses[nearest] if abs(stamps[nearest] - stamp_s) <= _SLACK_S else None
        first, last = stamps[after - 1], stamps[after]
        return between(poses[after - 1], poses[after], (stamp_s - first) / (last - first))
