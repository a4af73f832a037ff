"""Poses in space of a camera that moves freely, as given poses and odometry provide them.

A walking body has a planar pose instead; see `pose_source`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from ..primitives.frame import Frame
from ..primitives.landmark import Sighting
from ..primitives.pose import Pose3
from .filter import UpdateReport


class CameraPose(NamedTuple):
    """The camera of one frame. Axes of the origin, m and rad, rotation vector last.

    Args:
        T_origin_camera: Camera in the axes in which the source measures poses.
        shared: (6, 6) covariance of the part of the error that later poses inherit, as odometry accumulates it.
        of_view: (6, 6) covariance of the part that depends on the view, the same for every frame, see
            `perception.odometry.view_errors`.
    """

    T_origin_camera: Pose3
    shared: Float[np.ndarray, "6 6"]
    of_view: Float[np.ndarray, "6 6"]


@runtime_checkable
class CameraPoseSource(Protocol):
    """A pose source that knows the camera in space."""

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Take in the next frame."""
        ...

    @property
    def T_map_origin(self) -> Pose3 | None:
        """The axes of the poses in the upright map frame; None until a floor or gravity defines up."""
        ...

    @property
    def camera(self) -> CameraPose | None:
        """The camera of the latest frame; None if its pose is unknown."""
        ...
