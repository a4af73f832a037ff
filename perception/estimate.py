"""What one cycle of the pipeline concluded from one frame."""

from __future__ import annotations

from dataclasses import dataclass, field

from .filtering.consistency import Innovation
from .floor.segmented_view import SegmentedView
from .localisation.filter import UpdateReport
from .localisation.registration import RegistrationReport
from .monitoring.status import Doubt
from .monocular.colour_floor import ColourFloor
from .obstacles.clustering import Cluster
from .primitives.frame import ColourView
from .primitives.gaussian import Gaussian
from .primitives.landmark import Sighting
from .primitives.obstacle import Obstacle
from .primitives.pose import Pose2


@dataclass(frozen=True)
class Estimate:
    """What one cycle concluded.

    Args:
        stamp_s: Time of the frame, s.
        pose: Gaussian over (x, y, yaw) of the body in the map frame, m and rad; None for a handheld camera
            without poses.
        views: The depth images with floor and classes.
        clusters: Obstacles of this frame, body frame.
        obstacles: Tracks, map frame.
        landmarks: Result of the landmark update; None where no landmarks were looked for.
        innovations: Of the tracks that were seen.
        sightings: Landmarks seen in this frame, body frame.
        timing_ms: Wall time of each stage, ms.
        registration: Result of registering this frame to earlier ones; None where that is not done.
        colour: The colour picture of this frame.
        colour_floor: The floor by colour in it; None where it was not looked for.
        depth_healthy: Whether depth shows the floor ahead well enough to walk by.
        status: What is doubted, and what it asks of the walk; empty while all is well.
    """

    stamp_s: float
    pose: Gaussian | None
    views: tuple[SegmentedView, ...] = ()
    clusters: tuple[Cluster, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    landmarks: UpdateReport | None = None
    innovations: tuple[Innovation, ...] = ()
    sightings: tuple[Sighting, ...] = ()
    timing_ms: dict[str, float] = field(default_factory=dict)
    registration: RegistrationReport | None = None
    colour: ColourView | None = None
    colour_floor: ColourFloor | None = None
    depth_healthy: bool = True
    status: tuple[Doubt, ...] = ()

    @property
    def pose2(self) -> Pose2:
        """Mean pose; the origin where it is unknown."""
        if self.pose is None:
            return Pose2()
        x, y, yaw = (float(v) for v in self.pose.mean)
        return Pose2(x, y, yaw)
