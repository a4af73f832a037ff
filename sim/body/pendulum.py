"""The linear inverted pendulum: the body at constant height over the zero moment point (ZMP) p.

Its divergent component, the capture point xi = c + c'/w with w = sqrt(g / height), obeys xi' = w (xi - p).

Source: Kajita et al. 2001 (pendulum); Pratt et al. 2006 (capture point).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

GRAVITY_MPS2 = 9.81


@dataclass(frozen=True, eq=False)
class Phase:
    """A time interval over which the ZMP moves at constant velocity from start to end, m."""

    start: Float[np.ndarray, "2"]
    end: Float[np.ndarray, "2"]
    duration_s: float


def capture_point_before(
    after: Float[np.ndarray, "2"],
    phase: Phase,
    remaining_s: float | Float[np.ndarray, "n"],
    omega: float,
) -> Float[np.ndarray, "*n 2"]:
    """Capture point some time before the end of a phase: xi' = w (xi - p) solved backwards.

    Args:
        after: xi at the end of the phase, m.
        phase: Motion of the ZMP.
        remaining_s: Time to the end; for an array of times the result has one row each.
        omega: w = sqrt(g / height), 1/s.
    """
    speed = (phase.end - phase.start) / phase.duration_s
    left = np.asarray(remaining_s)[..., None]
    zmp = phase.end - speed * left
    away = after - phase.end - speed / omega
    return np.asarray(zmp + speed / omega + away * _exp(-omega * left))


def _exp(values: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Exponentials whose last bit, unlike that of NumPy, does not depend on the processor."""
    return np.array([math.exp(value) for value in values.flat]).reshape(values.shape)


def pendulum(
    position: float, velocity: float, zmp: float, seconds: float, height_m: float
) -> tuple[float, float]:
    """Position and velocity of the pendulum over a fixed ZMP after some time.

    Source: seed 000, section 3 (x(t) and x'(t), T_c = sqrt(z_c / g)).
    """
    T_c = math.sqrt(height_m / GRAVITY_MPS2)
    c, s = math.cosh(seconds / T_c), math.sinh(seconds / T_c)
    return (
        (position - zmp) * c + T_c * velocity * s + zmp,
        (position - zmp) / T_c * s + velocity * c,
    )
