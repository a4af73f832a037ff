"""What registration is told: errors of a scan as a whole, what is a partner, when the result is believed.

Source: walking trials as noted; the rest is ours, from walks in simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ..primitives.errors import ConfigError
from .scan import ScanConfig


@dataclass(frozen=True)
class RegistrationConfig:
    """Errors of a scan as a whole; what is a partner; when the result is believed."""

    enabled: bool = True  # False: landmarks and dead reckoning alone
    beside_landmarks: bool = (
        False  # ours: where tags are known they are surer alone (NEES 2.3, not 6)
    )
    scan: ScanConfig = field(default_factory=ScanConfig)
    ahead_sigma_m: float = 0.0045  # walking trials: trunk pitch of .5 deg, 0.38 m up; 3 mm of range
    aside_sigma_m: float = 0.005  # walking trials: trunk roll of .72 deg, likewise
    turn_sigma_rad: float = math.radians(0.4)  # walking trials: play of the neck
    alike: float = 1.5  # ours: neighbouring places err alike; so many count as one
    gate_m: float = 0.08  # ours: partners lie no further apart once the pose is known
    widest_gate_m: float = 0.40  # ours: however unsure the pose is
    facing_deg: float = 35.0  # ours: partners' normals differ by no more
    outlier_sigmas: float = 2.5  # ours: half the weight at this residual
    rounds: int = 8  # ours: of partners and pose
    together: int = 4  # ours: keyframes used at once, those with most partners
    least_places: int = 12  # ours: with partners; fewer tell nothing
    least_share: float = 0.3  # ours: of places with partners; fewer is another place
    known_share: float = 0.6  # ours: so many with one within the widest gate is no new place
    fitting_share: float = 0.15  # ours: of those that must then fit; furniture may have been moved
    rough_m: float = 0.02  # ours: weighted residual of a fit that holds, at most
    gate_probability: float = 0.9995  # ours: true registrations kept
    new_share: float = 0.6  # ours: a keyframe is taken where fewer places have partners
    most_keyframes: int = 80  # ours: 10 m through a home take 30
    doubt_after: int = 25  # ours: rejected in a row; 8 s of looking at what has been rearranged
    doubt_m: float = 0.25  # ours: deviation added then
    doubt_rad: float = math.radians(8.0)  # ours

    def __post_init__(self) -> None:
        for name in (
            "ahead_sigma_m",
            "aside_sigma_m",
            "turn_sigma_rad",
            "alike",
            "gate_m",
            "widest_gate_m",
            "outlier_sigmas",
            "rough_m",
            "doubt_m",
            "doubt_rad",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"registration: {name}={value} must be positive and finite")
        for name in ("rounds", "together", "least_places", "most_keyframes", "doubt_after"):
            if getattr(self, name) < 1:
                raise ConfigError(f"registration: {name}={getattr(self, name)} must be at least 1")
        if not 0.0 < self.gate_probability < 1.0:
            raise ConfigError(
                f"registration: gate_probability={self.gate_probability} must lie between 0 and 1"
            )
