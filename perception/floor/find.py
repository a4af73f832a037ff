"""The floor in one view: not the largest plane, but the lowest that is where a floor can be.

A table is often larger than the floor below it, and a wall than both. Several planes are proposed and taken
out one after the other; a plane that has a noticeable share of the points below it is no floor. Where
nothing fits there is no floor in this view, and that is an answer.

Source: seed 003, section 3 and Fig. 4; the choice among several planes is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _kernels
from .proposals import Gate, ProposalConfig, hough, ransac
from .refine import RefineConfig, fit


@dataclass(frozen=True)
class FloorConfig:
    """How the floor is looked for and when it is believed."""

    method: str = "ransac"  # or "hough"; both refined alike
    sample: int = 2048  # ours: spread evenly over the image
    planes: int = 6  # ours: proposals taken out one after the other
    tau_m: float = 0.01  # seed 003: tau = 0.01 + 3 sigma_Z h / Z
    tau_sigmas: float = 3.0  # seed 003
    gate_sigmas: float = 3.0  # ours: of the expected floor's covariance
    least_gate_deg: float = 5.0  # ours: kinematics are never trusted further; seed 003 allows 10
    most_gate_deg: float = 65.0  # ours: beyond, walls come in
    least_gate_m: float = 0.05  # seed 003: deviation in height from kinematics
    least_share: float = 0.02  # ours: of the points, on the floor
    least_points: int = 150  # ours
    most_below_share: float = 0.03  # ours: of the points, below a floor; holes and stray returns
    proposals: ProposalConfig = field(default_factory=ProposalConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)

    def __post_init__(self) -> None:
        if self.method not in ("ransac", "hough"):
            raise ConfigError(f"floor: method={self.method!r} is unknown; choose ransac or hough")
        if self.sample < 64 or self.planes < 1:
            raise ConfigError(
                f"floor: sample={self.sample} must be at least 64 and planes={self.planes} at least 1"
            )


@dataclass(frozen=True)
class Floor:
    """The floor as one view shows it.

    Args:
        plane: Camera frame, normal up, offset the camera's height, with covariance.
        share: Of the view's points that lie on it.
    """

    plane: Plane
    share: float


def find_floor(
    points: Points, expected: Plane, rng: np.random.Generator, config: FloorConfig | None = None
) -> Floor | None:
    """Find the plane the robot stands on.

    Args:
        points: One view, camera frame.
        expected: The floor before looking, camera frame, with covariance (see `prior`).
        rng: Draws the triples.
        config: Method and bounds.

    Returns:
        None if no plane in view can be the floor.
    """
    config = config or FloorConfig()
    if len(points.xyz) < config.least_points:
        return None
    gate = _gate(expected, config)
    chosen = np.linspace(0, len(points.xyz) - 1, min(config.sample, len(points.xyz)))
    index = np.unique(chosen.astype(np.int64))
    sample, sigma = np.ascontiguousarray(points.xyz[index]), points.sigma[index]
    tau = config.tau_m + config.tau_sigmas * sigma * np.abs(sample @ gate.up) / sample[:, 2]
    rough = _lowest(_candidates(sample, sigma, tau, gate, rng, config), sample, tau, config)
    if rough is None:
        return None
    refined = fit(points.xyz, points.sigma, rough, config.refine)
    if refined is None or not _inside(refined[0], gate):
        return None
    plane, count = refined
    share = count / len(points.xyz)
    if count < config.least_points or share < config.least_share:
        return None
    return Floor(plane, share)


def _gate(expected: Plane, config: FloorConfig) -> Gate:
    """Planes within some deviations of the expected floor."""
    tilt = math.sqrt(float(np.max(np.diag(expected.covariance)[:2])))
    angle = np.clip(
        config.gate_sigmas * tilt,
        math.radians(config.least_gate_deg),
        math.radians(config.most_gate_deg),
    )
    height = max(
        config.gate_sigmas * math.sqrt(float(expected.covariance[2, 2])), config.least_gate_m
    )
    return Gate(
        expected.normal,
        math.cos(float(angle)),
        max(expected.offset_m - height, 0.02),
        min(expected.offset_m + height, 5.0),
    )


def _inside(plane: Plane, gate: Gate) -> bool:
    """Whether a refined plane still is where it may be; refinement may carry it a little further."""
    slack = 0.02
    return (
        float(plane.normal @ gate.up) >= gate.cosine - slack
        and gate.lowest_m - slack <= plane.offset_m <= gate.highest_m + slack
    )


def _candidates(
    sample: Float[np.ndarray, "m 3"],
    sigma: Float[np.ndarray, "m"],
    tau: Float[np.ndarray, "m"],
    gate: Gate,
    rng: np.random.Generator,
    config: FloorConfig,
) -> list[Plane]:
    """Planes of the sample, each found in what those before it left."""
    propose = ransac if config.method == "ransac" else hough
    left = np.ones(len(sample), dtype=bool)
    found: list[Plane] = []
    for _ in range(config.planes):
        if np.count_nonzero(left) < max(32, config.least_share * len(sample)):
            break
        part, bound = np.ascontiguousarray(sample[left]), tau[left]
        rough = propose(part, bound, gate, config.proposals, rng)
        if rough is None:
            break
        plane = _polish(part, sigma[left], bound, rough, config.refine)
        close = np.abs(plane.distance(sample)) < tau
        if np.count_nonzero(close & left) < config.least_share * len(sample):
            break
        if _inside(plane, gate):
            found.append(plane)
        left &= ~(np.abs(plane.distance(sample)) < 1.5 * tau)
    return found


def _polish(
    sample: np.ndarray, sigma: np.ndarray, tau: np.ndarray, rough: Plane, config: RefineConfig
) -> Plane:
    """Local optimisation: the least-squares plane of the sample, if it is the cheaper one."""
    better = fit(sample, sigma, rough, config)
    if better is None:
        return rough
    cost = _kernels.truncated_cost(sample, tau, rough.normal, rough.offset_m)
    other = _kernels.truncated_cost(sample, tau, better[0].normal, better[0].offset_m)
    return better[0] if other < cost else rough


def _lowest(
    candidates: list[Plane],
    sample: Float[np.ndarray, "m 3"],
    tau: Float[np.ndarray, "m"],
    config: FloorConfig,
) -> Plane | None:
    """Of the planes with nearly nothing below them, the one that most points lie on."""
    best, most = None, 0
    for plane in candidates:
        distance = plane.distance(sample)
        below = np.count_nonzero(distance < -(2.0 * tau + 0.02))
        on = np.count_nonzero(np.abs(distance) < tau)
        if below <= config.most_below_share * len(sample) and on > most:
            best, most = plane, on
    return best
