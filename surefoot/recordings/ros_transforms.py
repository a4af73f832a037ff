"""The tree of transforms that a bag tells piece by piece, and any way through it.

Between two stamps a transform is interpolated; beyond the ends it is not known.

Source: Foote, "tf: The transform library" (TePRA 2013).
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from perception.primitives.pose import Pose3

_SLACK_S = 0.1  # a pose this little before the first or after the last told one is that one


class Transforms:
    """Edges from parent to child, fixed or over time."""

    def __init__(self) -> None:
        self._fixed: dict[str, tuple[str, Pose3]] = {}
        self._moving: dict[str, tuple[str, list[float], list[Pose3]]] = {}

    def add(self, parent: str, child: str, stamp_s: float | None, transform: Any) -> None:
        """One told transform: pose of the child in its parent; without a stamp it holds always."""
        q, t = transform.rotation, transform.translation
        quaternion = np.array([q.x, q.y, q.z, q.w], dtype=np.float64)
        length = float(np.linalg.norm(quaternion))
        if not (np.isfinite(length) and length > 0.5):
            return
        x, y, z, w = (float(v) for v in quaternion / length)
        pose = Pose3((float(t.x), float(t.y), float(t.z)), (x, y, z, w))
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if stamp_s is None:
            self._fixed[child] = (parent, pose)
            return
        _, stamps, poses = self._moving.setdefault(child, (parent, [], []))
        if not stamps or stamp_s > stamps[-1]:
            stamps.append(stamp_s)
            poses.append(pose)

    def first_leading_to(self, candidates: Sequence[str], child: str) -> str | None:
        """The first candidate among the ancestors of a frame that something moving hangs between."""
        chain = self._chain(child)
        moving = [name for name in chain if name in self._moving]
        ancestors = chain[chain.index(moving[0]) + 1 :] if moving else []
        return next((name for name in candidates if name in ancestors), None)

    def between(self, frame: str, other: str, stamp_s: float) -> Pose3 | None:
        """Pose of `other` in `frame` at that time; None where nothing leads from one to the other."""
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

    def _parent(self, frame: str) -> str | None:
        edge = self._moving.get(frame) or self._fixed.get(frame)
        return None if edge is None else edge[0]

    def _up(self, chain: Sequence[str], top: str, stamp_s: float) -> Pose3 | None:
        """Pose of the head of a chain in one of its members."""
        pose = Pose3()
        for name in chain[: chain.index(top)]:
            edge = self._at(name, stamp_s)
            if edge is None:
                return None
            pose = edge @ pose
        return pose

    def _at(self, child: str, stamp_s: float) -> Pose3 | None:
        if child not in self._moving:
            return self._fixed[child][1]
        _, stamps, poses = self._moving[child]
        after = bisect.bisect_left(stamps, stamp_s)
        if after == 0 or after == len(stamps):
            nearest = min(after, len(stamps) - 1)
            return poses[nearest] if abs(stamps[nearest] - stamp_s) <= _SLACK_S else None
        first, last = stamps[after - 1], stamps[after]
        a, b = poses[after - 1], poses[after]
        share = (stamp_s - first) / (last - first)
        turn = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([a.rotation, b.rotation])))(share)
        return Pose3.from_rotation(
            turn.as_matrix(), (1.0 - share) * a.position + share * b.position
        )
