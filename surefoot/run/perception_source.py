"""The protocol of a perception source: from a frame of the sensors to the world model that planners read.

`pipeline.Pipeline` processes images; `experiments.support.geometric_perception` simulates detections from the geometry
of the scene, for studies of many hours of walking.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from perception.primitives.frame import Frame
from planning.world_model import WorldModel


@runtime_checkable
class PerceptionSource(Protocol):
    """Takes the frames of a run one by one."""

    def cycle(self, frame: Frame) -> WorldModel:
        """The world model after this frame."""
        ...
