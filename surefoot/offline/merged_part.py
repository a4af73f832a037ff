"""One part of a merge as a map folder: the images of its sessions fused at their new poses, and what changed in it.

The sessions follow each other in one trajectory: the stamps of each but the first are shifted behind those of the one
before. An image that is no variable of the graph moves with the nearest one in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from mapping.objects.changes import Change, ChangedObject, Look, find_changes
from perception.odometry.pose_uncertainty import (
    AttachedImage,
    PoseUncertainty,
    planar_gaussian,
    pose_uncertainty,
)
from perception.odometry.session_graph import Joined, relative_covariance
from perception.odometry.view_errors import view_error_covariances
from perception.primitives.pose import Pose3

from ..config import toml
from ..progress import Say
from ..results.camera_trajectory import write_poses
from ..results.run_folder import RunFolder
from ..results.trajectory_uncertainty import write_covariances
from .fusion import Fusion
from .g2o import write_g2o
from .mapped_session import MappedSession, SessionImages
from .placed_images import PlacedImage

BETWEEN_S = 10.0  # ours: pause between two sessions in the joint trajectory
LEAST_CHANGE = 0.5  # ours: probability of a change that is reported


class Span(NamedTuple):
    """A session in the joint trajectory: seconds added to its stamps, first and last stamp."""

    shift_s: float
    from_s: float
    to_s: float


@dataclass(frozen=True, eq=False)
class Part:
    """Sessions that belong together, with what is known of them.

    Args:
        joined: Their joint solution.
        mapped, images: All sessions, by number.
    """

    joined: Joined
    mapped: Sequence[MappedSession]
    images: Sequence[SessionImages]

    def spans(self) -> dict[int, Span]:
        """Of each session."""
        found: dict[int, Span] = {}
        end: float | None = None
        for k in self.joined.sessions:
            trajectory = self.mapped[k].folder.read_trajectory("trajectory.txt")
            assert trajectory is not None
            first, last = float(trajectory.stamps[0]), float(trajectory.stamps[-1])
            shift = 0.0 if end is None else end + BETWEEN_S - first
            end = last + shift
            found[k] = Span(shift, first + shift, end)
        return found

    def corrections(self, session: int) -> list[Pose3]:
        """T_part_session at each of its variables."""
        before = self.images[session].graph.poses
        return [
            new @ old.inverse() for new, old in zip(self.joined.poses[session], before, strict=True)
        ]

    def uncertainty(self) -> PoseUncertainty:
        """Covariances of every variable, part axes."""
        every = [pose for k in self.joined.sessions for pose in self.joined.poses[k]]
        none = np.zeros((6, 6))
        images = [AttachedImage(pose, number, none) for number, pose in enumerate(every)]
        return pose_uncertainty(self.joined.factors, dict(enumerate(every)), images)


@dataclass(frozen=True)
class Written:
    """What a part became.

    Args:
        frames: Images fused.
        vertices: Of the mesh.
        walkable_m2: Area on which a robot can walk.
        spans: Of its sessions in its trajectory.
        changes: What changed between its sessions.
    """

    frames: int
    vertices: int
    walkable_m2: float
    spans: dict[int, Span]
    changes: list[dict[str, Any]]


def write_part(part: Part, folder: RunFolder, say: Say) -> Written:
    """Write trajectory, graph, surface, maps and changes of a part."""
    joined = part.joined
    folder.write_text("config.toml", toml.dumps(part.mapped[joined.sessions[0]].config))
    fusion = Fusion(folder, part.mapped[joined.sessions[0]].config)
    spans, uncertainty = part.spans(), part.uncertainty()
    rows: list[tuple[float, AttachedImage]] = []
    frames = 0
    for session in joined.sessions:
        images, begin = part.images[session], joined.numbers[session]
        corrections, stamps = part.corrections(session), np.array(images.stamps)
        own = part.mapped[session].covariances()
        for image in part.mapped[session].placed().images():
            nearest = int(np.argmin(np.abs(stamps - image.stamp_s)))
            number = begin + nearest
            moved = _corrected(image, corrections[nearest], uncertainty.from_start[number])
            stamp = image.stamp_s + spans[session].shift_s
            frames += not rows or rows[-1][0] != stamp
            fusion.add(moved._replace(stamp_s=stamp), float(frames))
            if not rows or rows[-1][0] != stamp:
                since = np.zeros((6, 6))
                if image.stamp_s != images.stamps[nearest]:
                    since = relative_covariance(
                        own.get(images.stamps[nearest], since),
                        own.get(image.stamp_s, since),
                        joined.poses[session][nearest],
                        moved.T_map_camera,
                    )
                rows.append((stamp, AttachedImage(moved.T_map_camera, number, since)))
            say(f"surface: session {session + 1}, frame {frames}")
    fusion.close()
    _write_trajectory(part, folder, rows)
    vertices, walkable_m2 = fusion.write(say)
    changes = _changes(part, uncertainty.aligned, say)
    folder.write_json("changes.json", {"changes": changes})
    return Written(frames, vertices, walkable_m2, spans, changes)


def _corrected(
    image: PlacedImage, correction: Pose3, covariance: Float[np.ndarray, "6 6"]
) -> PlacedImage:
    """An image at its place in the part."""
    T = correction @ image.T_map_camera
    pose = planar_gaussian(T, covariance)
    return image._replace(T_map_camera=T, pose=pose, floor=image.floor.moved(correction))


def _write_trajectory(
    part: Part, folder: RunFolder, rows: Sequence[tuple[float, AttachedImage]]
) -> None:
    """Write the joint trajectory, its covariances and the graph."""
    joined = part.joined
    stamps = [stamp for stamp, _ in rows]
    images = [image for _, image in rows]
    poses = [image.pose for image in images]
    write_poses(folder, "trajectory.txt", zip(stamps, poses, strict=True))
    every = [pose for k in joined.sessions for pose in joined.poses[k]]
    found = pose_uncertainty(joined.factors, dict(enumerate(every)), images)
    sizes = [part.images[k].view_error.covariance for k in joined.sessions]
    views = view_error_covariances(
        np.array([pose.position for pose in poses]),
        np.array([pose.rotation for pose in poses]),
        np.mean(sizes, axis=0),
    )
    claims = PoseUncertainty(found.from_start + views.from_start, found.aligned + views.aligned)
    write_covariances(folder, stamps, poses, claims)
    if joined.solution is not None:
        write_g2o(folder.path("graph.g2o"), joined.factors, joined.solution)


def _changes(part: Part, covariances: Float[np.ndarray, "n 6 6"], say: Say) -> list[dict[str, Any]]:
    """What changed between every two sessions, from the lower to the higher number.

    Args:
        part: The sessions.
        covariances: Of every variable after alignment of the whole part: an error relative to its first image that all
            images share does not separate their surfaces.
        say: Progress.
    """
    found = []
    looks = {k: _looks(part, covariances, k) for k in part.joined.sessions}
    for one, other in combinations(sorted(looks), 2):
        say(f"changes: session {one + 1} and {other + 1}")
        for change in find_changes(looks[one], looks[other]):
            if change.probability >= LEAST_CHANGE:
                found.append({"sessions": [one + 1, other + 1], **_entry(change)})
    return found


def _looks(part: Part, covariances: Float[np.ndarray, "n 6 6"], session: int) -> list[Look]:
    """The depth images of a session at their places in the part."""
    found, begin = [], part.joined.numbers[session]
    for k, pose in enumerate(part.joined.poses[session]):
        level = part.images[session].session.pyramid(k).levels[0]
        sigma_m = float(np.sqrt(np.trace(covariances[begin + k][:3, :3]) / 3.0))
        found.append(Look(level.z, level.sigma, level.camera, pose, sigma_m))
    return found


def _entry(change: Change) -> dict[str, Any]:
    """A change for changes.json."""
    return {
        "kind": change.kind,
        "probability": change.probability,
        "before": None if change.before is None else _object(change.before),
        "after": None if change.after is None else _object(change.after),
    }


def _object(one: ChangedObject) -> dict[str, Any]:
    return {
        "outline_m": one.outline.tolist(),
        "position_m": one.position.tolist(),
        "covariance": one.covariance.tolist(),
        "size_m": one.size.tolist(),
        "probability": one.probability,
        "voxels": one.voxels,
    }
