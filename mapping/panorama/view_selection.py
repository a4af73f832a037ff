"""Which frames of a moving camera become views of a panorama.

A frame becomes a view when the camera has turned or moved since all former views. Frames too far from the first
view are left out, because a panorama has one centre.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3
from perception.primitives.settings import setting


@dataclass(frozen=True)
class ViewSelectionConfig:
    """Selection of the views."""

    turn_deg: float = setting(
        12.0, "deg", "turn of the camera that makes a new view", "ours: a third of a narrow view"
    )
    step_m: float = setting(
        0.15, "m", "motion of the camera that makes a new view", "ours: as the turn, at 1 m"
    )
    radius_m: float = setting(
        0.75,
        "m",
        "largest distance of a view from the first one",
        "ours: a panorama has one centre",
    )
    most_views: int = setting(
        40, "", "largest number of views", "ours: the pairs grow with its square"
    )
    by_pictures: bool = setting(
        False,
        "",
        "place the views by their pictures alone, without the poses of the camera",
        "seed 004: nine views from one place, matched by features",
    )

    def __post_init__(self) -> None:
        for name in ("turn_deg", "step_m", "radius_m"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"panorama: {name}={getattr(self, name)} must be positive")
        if self.most_views < 1:
            raise ConfigError(f"panorama: most_views={self.most_views} must be at least 1")

    def is_new(self, pose: Pose3, views: Sequence[Pose3]) -> bool:
        """Whether the camera has turned or moved since every former view.

        Args:
            pose: T_base_camera.
            views: T_base_camera of the former views.
        """
        for view in views:
            cosine = (float(np.trace(view.rotation.T @ pose.rotation)) - 1.0) / 2.0
            turned = math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
            moved = float(np.linalg.norm(pose.position - view.position))
            if turned < self.turn_deg and moved < self.step_m:
                return False
        return True

    def is_near(self, pose: Pose3, views: Sequence[Pose3]) -> bool:
        """Whether the camera is near enough to the first view; with `by_pictures` it always is."""
        if self.by_pictures or not views:
            return True
        return float(np.linalg.norm(pose.position - views[0].position)) <= self.radius_m
