"""The tree of transforms of a bag, and the transform between any two of its frames.

A transform is interpolated between two stamps and unknown outside its time range.

Source: Foote, "tf: The transform library" (TePRA 2013).
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from perception.primitives.pose import Pose3

_SLACK_S = (
    0.1  # ours: so shortly before the first or after the last stamp, the nearest pose is used
)


class Transforms:
    """Edges from parent to child, static or over time."""

    def __init__(self) -> None:
        self._static: dict[str, tuple[str, Pose3]] = {}
        self._moving: dict[str, tuple[str, list[float], list[Pose3]]] = {}

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
        _, stamps, poses = self._moving.setdefault(child, (parent, [], []))
        if not stamps or stamp_s > stamps[-1]:
            stamps.append(stamp_s)
            poses.append(pose)

    def first_leading_to(self, candidates: Sequence[str], child: str) -> str | None:
        """The first candidate that is an ancestor of the frame above a moving edge; None without one."""
        chain = self._chain(child)
        moving = [name for name in chain if name in self._moving]
        ancestors = chain[chain.index(moving[0]) + 1 :] if moving else []
        return next((name for name in candidates if name in ancestors), None)

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

    def _parent(self, frame: str) -> str | None:
        edge = self._moving.get(frame) or self._static.get(frame)
        return None if edge is None else edge[0]

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
