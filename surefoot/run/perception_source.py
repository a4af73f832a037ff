"""The protocol of a perception source: from a frame of the sensors to the world model that planners read.

`pipeline.Pipeline` measures from images; `experiments.support.geometric_perception` computes what the sensors would
show from the simulator's geometry, for studies that walk for hours.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from perception.primitives.frame import Frame
from planning.world_model import WorldModel


@runtime_checkable
class PerceptionSource(Protocol):
    """Takes the frames of a run one by one."""

    def cycle(self, frame: Frame) -> WorldModel:
        """The world as known after this frame."""
        ...
