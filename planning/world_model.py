"""What planning reads: the estimate of one frame and the maps built up to it.

The pipeline makes one for every frame, and so does any other perception source. Planners read it and change
nothing in it. All fields have defaults, so that a program or a test can fill in the parts it has.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.grid.world_map import WorldMap
from mapping.ground.levels import Levels
from perception.estimate import Estimate
from perception.primitives.landmark import Landmark

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mapping.ground.levels import LevelView
    from perception.floor.segmented_view import SegmentedView
    from perception.monocular.colour_floor import ColourFloor
    from perception.primitives.gaussian import Gaussian
    from perception.primitives.obstacle import Obstacle
    from perception.primitives.plane import Plane
    from perception.primitives.pose import Pose2


@dataclass(frozen=True, eq=False)
class WorldModel:
    """The state of the world as known after one frame.

    Args:
        estimate: What this frame's sensors gave.
        grid: Egocentric occupancy grid; None before the first depth image.
        confidence: How fresh the grid's cells are; None likewise.
        world_map: Occupancy of the whole run; None if none is kept.
        landmarks: Known beforehand, map frame.
        levels: Ground of several levels; None where the ground is one floor.
    """

    estimate: Estimate
    grid: EgocentricGrid | None = None
    confidence: ConfidenceLayer | None = None
    world_map: WorldMap | None = None
    landmarks: Sequence[Landmark] = ()
    levels: Levels | None = None

    @property
    def stamp_s(self) -> float:
        """Time of the frame, s."""
        return self.estimate.stamp_s

    @property
    def pose(self) -> Gaussian | None:
        """Gaussian over (x, y, yaw) of the body in the map frame, m and rad; None if unknown."""
        return self.estimate.pose

    @property
    def pose2(self) -> Pose2:
        """Mean pose; the origin where it is unknown."""
        return self.estimate.pose2

    @property
    def tracks(self) -> Sequence[Obstacle]:
        """Tracked obstacles, map frame."""
        return self.estimate.obstacles

    @property
    def views(self) -> Sequence[SegmentedView | LevelView]:
        """The depth images of this frame, each with its sensor and the place of the camera."""
        return self.estimate.views if self.levels is None else self.levels.views

    @property
    def floor(self) -> Plane | None:
        """The floor seen by the first depth camera, camera frame, with covariance; None if none saw it."""
        seen = (view.floor for view in self.estimate.views if view.seen is not None)
        return next(seen, None)

    @property
    def colour_floor(self) -> ColourFloor | None:
        """The floor by colour in this frame's picture; None where it was not looked for."""
        return self.estimate.colour_floor
