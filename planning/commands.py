"""Commands to a body: the next footstep, and the gaze."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WalkCommand:
    """C_w of seed 000: one footstep.

    Args:
        forward_m: S_F, sagittal step.
        lateral_m: S_L, lateral step, left positive.
        turn_rad: theta, change of heading over the step, left positive (clockwise in the paper).
        single_support_s: T_SS.
        double_support_s: T_DS.
        rise_m: Height at which the foot lands above the foot that stands; 0 on flat ground. Ours.
        stay: Whether the feet stay where they are, also on two levels; without it a step of no length joins them. Ours.

    Source: seed 000, section 2.1.
    """

    forward_m: float = 0.0
    lateral_m: float = 0.0
    turn_rad: float = 0.0
    single_support_s: float = 0.30
    double_support_s: float = 0.35
    rise_m: float = 0.0
    stay: bool = False

    @property
    def duration_s(self) -> float:
        """Duration of the step."""
        return self.single_support_s + self.double_support_s


@dataclass(frozen=True)
class GazeCommand:
    """theta* of seed 001: head angles, pan left positive, tilt down positive, rad."""

    pan_rad: float = 0.0
    tilt_rad: float = 0.0
