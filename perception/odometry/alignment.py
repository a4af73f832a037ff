"""Alignment of two RGB-D images: their relative pose and its covariance.

Each pixel of the source projects onto a pixel of the target. Gauss-Newton with Huber weights minimises its
distance to the plane there and the difference of grey values, from the coarsest pyramid level to the finest.
Without colour, depth alone is used.

Source: Newcombe et al. 2011 (point to plane, projective association); Steinbrücker et al. 2011 (grey values);
Huber 1964. The choice among initial poses and the covariance factor are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from ..primitives.settings import setting
from . import _align_kernels as kernels
from .likelihood import COMMON_PX, likelier, residuals
from .pyramid import Level, Pyramid

METHODS = ("hybrid", "depth")
SAME = 0.02  # ours: m and entries of a rotation matrix: estimates this close are one
ROUNDS = (6, 8, 12)  # ours: iterations per level, finest first; each level stops when it converges
COARSEST_GATE_M = 0.30  # ours: larger residuals at the start belong to other surfaces
FINEST_GATE_M = 0.03  # ours: and at the end
GREY_SIGMA = 10.0  # ours: of 255, at the start; estimated from the residuals afterwards
CONVERGED = 1e-4  # m and rad: a smaller step is the last one of its level
LIGHT_ROUNDS = 4  # ours: iterations of the grey differences at a known motion
KEPT = 3  # ours: initial poses that are carried from the coarsest level to the next
# Errors that are a share of the motion: of the focal length (ours: half a percent once calibrated), and of the
# depth scale (ours: a share of the bend, so that both are 1 % for the published bend of an RGB-D camera at 2 m)
LENS_WARP = 0.005
WARP_PER_BEND = 0.62
BEND_SHARE = 0.25  # ours: regions of common depth error are about a quarter of the image wide


@dataclass(frozen=True)
class AlignConfig:
    """How two images are aligned."""

    method: str = setting(
        "hybrid", "", "aligns by depth and grey values (hybrid) or by depth alone (depth)", "ours"
    )

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(
                f"odometry: method={self.method!r} is unknown; choose {', '.join(METHODS)}"
            )


@dataclass(frozen=True)
class Alignment:
    """Relative pose of two images and its quality.

    Args:
        motion: T_target_source.
        covariance: (6, 6) of (x, y, z, rotation vector), axes of the target, m and rad.
        fitting: Share of inliers: points of the source off the floor that lie on surfaces of the target, among
            those in its view.
        visible: Share of the points off the floor that are in the target's view.
        contradicting: Share of the points in view that lie where the target saw free space.
        error: Root mean square distance to the surfaces, in standard deviations.
    """

    motion: Pose3
    covariance: Float[np.ndarray, "6 6"]
    fitting: float
    visible: float
    contradicting: float
    error: float

    @property
    def overlap(self) -> float:
        """Score of the alignment: inliers minus contradicting points, with a small weight on points out of view."""
        return (self.fitting - self.contradicting) * self.visible / (0.7 * self.visible + 0.3)


def align(
    target: Pyramid,
    source: Pyramid,
    starts: Sequence[Pose3] = (Pose3(),),
    config: AlignConfig | None = None,
) -> Alignment | None:
    """Estimate the motion between two images.

    Args:
        target: The image that is held fixed; its planes are computed if they are not yet.
        source: The image that is moved.
        starts: Initial values of T_target_source. All are refined on the coarsest level; those with the best
            overlap off the floor are carried on, and first the one that explains the images better than these.
        config: Method; the defaults if None.

    Returns:
        None if the images do not determine a motion.
    """
    config = config or AlignConfig()
    grey_sigma = GREY_SIGMA if _with_grey(target, source, config) else 0.0
    tried = [(0.0, start.matrix, np.array([grey_sigma, 0.0])) for start in starts]
    for number in range(_coarsest(target, source), -1, -1):
        refined = []
        for _, T, light in tried:
            totals = _refine(target, source, number, T, light)
            refined.append((_overlap(totals), T, light))
        distinct = _distinct(refined)
        leader = _likeliest(target, source, [T for _, T, _ in distinct], grey_sigma > 0.0)
        ranked = [distinct[leader], *distinct[:leader], *distinct[leader + 1 :]]
        tried = ranked[: KEPT if number > 1 else 1]
    _, T, light = tried[0]
    return evaluate(target, source, T, light)


_Try = tuple[float, np.ndarray, np.ndarray]


def same(T: Float[np.ndarray, "4 4"], other: Float[np.ndarray, "4 4"]) -> bool:
    """True if two estimates of a motion differ by their refinement only."""
    return not np.max(np.abs(T - other)) > SAME  # also what is not a number


def _distinct(refined: list[_Try]) -> list[_Try]:
    """The candidates without duplicates, that with the best overlap first."""
    kept: list[_Try] = []
    for one in sorted(refined, key=lambda one: -one[0]):
        if not any(same(one[1], other[1]) for other in kept):
            kept.append(one)
    return kept


def _likeliest(
    target: Pyramid, source: Pyramid, motions: Sequence[np.ndarray], with_grey: bool
) -> int:
    """Number of the motion that explains the images best; the first one in doubt."""
    if len(motions) == 1:
        return 0
    found = [residuals(target, source, Pose3.from_matrix(T), with_grey) for T in motions]
    best = 0
    for number in range(1, len(found)):
        if likelier(found[number], found[best]):
            best = number
    return best


def explains_better(
    target: Pyramid, source: Pyramid, motion: Pose3, other: Pose3, config: AlignConfig
) -> bool:
    """True if the images are likelier with `motion` than with `other`, and not by chance."""
    pair = [other.matrix, motion.matrix]
    return _likeliest(target, source, pair, _with_grey(target, source, config)) == 1


def _with_grey(target: Pyramid, source: Pyramid, config: AlignConfig) -> bool:
    return target.has_grey and source.has_grey and config.method == "hybrid"


def evaluate(
    target: Pyramid,
    source: Pyramid,
    T: Float[np.ndarray, "4 4"],
    light: Float[np.ndarray, "2"] | None = None,
) -> Alignment | None:
    """Quality and covariance of a motion on the finest level; None if the images do not determine it."""
    light = np.zeros(2) if light is None else light
    totals = _equations(target.levels[0], source.levels[0], T, FINEST_GATE_M, light)
    if totals[kernels.GEOMETRIC_COUNT] < 6 * COMMON_PX:
        return None
    error = math.sqrt(totals[kernels.GEOMETRIC] / totals[kernels.GEOMETRIC_COUNT])
    information = np.zeros((6, 6))
    information[np.triu_indices(6)] = totals[:21]
    information += np.triu(information, 1).T
    alike = max(error, 1.0) ** 2 * COMMON_PX * information
    covariance = _covariance(information, T, alike + _depth_bend_scatter(target, source, T))
    if covariance is None:
        return None
    turned = math.acos(min(1.0, max(-1.0, (float(np.trace(T[:3, :3])) - 1.0) / 2.0)))
    share = math.hypot(LENS_WARP, WARP_PER_BEND * source.bend)
    warp = np.array([float(np.linalg.norm(T[:3, 3]))] * 3 + [turned] * 3) * share
    covariance = covariance + np.diag(warp**2)
    fitting, visible, contradicting = _shares(totals)
    return Alignment(Pose3.from_matrix(T), covariance, fitting, visible, contradicting, error)


def fitted_light(to: Level, of: Level, T: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "2"]:
    """(standard deviation, mean) of the grey differences of two images at a motion; a deviation of 0 without grey."""
    with_grey = to.grey.shape == to.z.shape and of.grey.shape == of.z.shape
    light = np.array([GREY_SIGMA if with_grey else 0.0, 0.0])
    for _ in range(LIGHT_ROUNDS):
        totals = _equations(to, of, T, FINEST_GATE_M, light)
        kernels.brighten(light, totals)
    return light


def _coarsest(target: Pyramid, source: Pyramid) -> int:
    """Number of the coarsest level that both have; a small image has fewer."""
    return min(len(target.levels), len(source.levels)) - 1


def _refine(
    target: Pyramid,
    source: Pyramid,
    number: int,
    T: np.ndarray,
    light: np.ndarray,
) -> np.ndarray:
    """Refine T on one level; the gate is wide on the coarsest level and narrows from there."""
    to, of = target.levels[number], source.levels[number]
    coarsest = number == _coarsest(target, source)
    least = FINEST_GATE_M * 2.0**number
    totals = np.empty(kernels.TOTALS)
    gate = COARSEST_GATE_M if coarsest else least
    rounds = ROUNDS[min(number, len(ROUNDS) - 1)]
    kernels.refine(of.as_source, to.as_target, T, gate, least, light, rounds, CONVERGED, totals)
    return totals


def _equations(to: Level, of: Level, T: np.ndarray, gate_m: float, light: np.ndarray) -> np.ndarray:
    totals = np.empty(kernels.TOTALS)
    kernels.equations(of.as_source, to.as_target, T, gate_m, light, totals)
    return totals


def _shares(totals: np.ndarray) -> tuple[float, float, float]:
    seen = max(float(totals[kernels.VISIBLE]), 1.0)
    return (
        float(totals[kernels.FITTING]) / seen,
        seen / max(float(totals[kernels.VALID]), 1.0),
        float(totals[kernels.CONTRADICTING]) / seen,
    )


def _overlap(totals: np.ndarray) -> float:
    fitting, visible, contradicting = _shares(totals)
    return Alignment(Pose3(), np.zeros((6, 6)), fitting, visible, contradicting, 0.0).overlap


def _depth_bend_scatter(
    target: Pyramid, source: Pyramid, T: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "6 6"]:
    """Scatter of the gradient caused by depth errors that are common to large regions of the image.

    The error is fixed to the pixels: two images from one pose share it and it cancels; it matters where a point
    is seen by other pixels than before.
    """
    to, of = target.levels[0], source.levels[0]
    side = BEND_SHARE * of.camera.width
    patches = math.ceil(of.camera.width / side) * math.ceil(of.camera.height / side)
    pulls = np.empty((patches, 6))
    moved = kernels.bends(
        of.as_source, to.as_target, T, FINEST_GATE_M, side, pulls
    )  # fmt: skip
    unlike = 1.0 - math.exp(-0.5 * (moved / side) ** 2)
    return np.asarray(2.0 * unlike * source.bend**2 * pulls.T @ pulls)


def _covariance(
    information: np.ndarray, T: np.ndarray, scatter: np.ndarray
) -> Float[np.ndarray, "6 6"] | None:
    """Covariance of (position, rotation vector) in the target's axes, from the information about its origin.

    Pixel errors are correlated, so the scatter of the gradient exceeds the information, and the covariance is
    Huber's sandwich.
    """
    try:
        inverse = np.linalg.inv(information)
    except np.linalg.LinAlgError:
        return None
    covariance = inverse @ scatter @ inverse
    if not np.all(np.diag(covariance) > 0.0):
        return None
    x, y, z = T[:3, 3]
    moved = np.eye(6)
    moved[:3, 3:] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    covariance = moved @ covariance @ moved.T
    return np.asarray((covariance + covariance.T) / 2.0)
