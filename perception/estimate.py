"""What one cycle of the pipeline concluded."""

from __future__ import annotations

from dataclasses import dataclass, field

from .filtering.consistency import Innovation
from .floor.segmented_view import SegmentedView
from .localisation.filter import UpdateReport
from .localisation.registration import RegistrationReport
from .obstacles.clustering import Cluster
from .primitives.gaussian import Gaussian
from .primitives.landmark import Sighting
from .primitives.obstacle import Obstacle
from .primitives.pose import Pose2


@dataclass(frozen=True)
class Estimate:
    """What one cycle concluded.

    Args:
        stamp_s: Of the frame.
        pose: Gaussian over (x, y, yaw) of the body in the map frame; None for a camera in the hand
            without poses.
        views: The depth images, understood.
        clusters: Obstacles of this frame, body frame.
        obstacles: Tracks, map frame.
        landmarks: What the localiser made of the landmarks; None where none were looked for.
        innovations: Of the tracks that were seen.
        sightings: Landmarks seen in this frame, body frame.
        timing_ms: Wall time of each stage.
        registration: What came of laying this frame over those before; None where nobody compares.
    """

    stamp_s: float
    pose: Gaussian | None
    views: tuple[SegmentedView, ...]
    clusters: tuple[Cluster, ...]
    obstacles: tuple[Obstacle, ...]
    landmarks: UpdateReport | None
    innovations: tuple[Innovation, ...] = ()
    sightings: tuple[Sighting, ...] = ()
    timing_ms: dict[str, float] = field(default_factory=dict)
    registration: RegistrationReport | None = None

    @property
    def pose2(self) -> Pose2:
        """Mean pose; the origin where there is none."""
        if self.pose is None:
            return Pose2()
        x, y, yaw = (float(v) for v in self.pose.mean)
        return Pose2(x, y, yaw)
