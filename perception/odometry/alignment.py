"""Two RGB-D images laid over each other: how the camera moved between them, and how sure that is.

Each pixel of the source falls on a pixel of the target; its distance to the plane there, and the difference
of the grey values, are what Gauss-Newton makes small, from the coarsest size to the finest, with Huber's
weights. Depth alone leaves the grey values out.

Source: Newcombe et al. 2011 (point to plane, projective); Steinbrücker et al. 2011 (grey); Huber 1964. Start
hypotheses judged by overlap off the floor, and the covariance's factor, are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from . import _align_kernels as kernels
from .pyramid import Level, Pyramid

METHODS = ("hybrid", "depth")
SAME = 0.02  # ours: m and parts of a rotation matrix: starts that end so near are one


@dataclass(frozen=True)
class AlignConfig:
    """How images are laid over each other."""

    method: str = "hybrid"  # depth and grey; "depth" alone is point to plane
    rounds: tuple[int, ...] = (6, 8, 12)  # ours: finest first; each stops when it moves no more
    coarsest_gate_m: float = 0.30  # ours: residuals beyond are other surfaces, at the start
    finest_gate_m: float = 0.03  # ours: and at the end
    grey_sigma: float = 10.0  # ours: of 255, at the start; learnt on the way
    settled: float = 1e-4  # m and rad: a step so small is the last one of its level
    kept: int = 3  # ours: starts that go on from the coarsest size to the next
    common_px: float = 15.0  # ours: pixels that err alike; NEES of 6 on ray-cast depth with noise
    warp: float = 0.01  # ours: lens, depth scale and shutter bend the view by so much of the motion
    bend: float = 0.01  # ours: depth cameras are off by a percent over parts of the image
    bend_share: float = 0.25  # likewise: such parts are about a quarter of the image wide

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(
                f"odometry: method={self.method!r} is unknown; choose one of {METHODS}"
            )
        if not self.rounds or min(self.rounds) < 1:
            raise ConfigError(f"odometry: rounds={self.rounds} must each be at least 1")
        if not 0.0 < self.finest_gate_m <= self.coarsest_gate_m:
            raise ConfigError(
                f"odometry: finest_gate_m={self.finest_gate_m} must be positive and at most "
                f"coarsest_gate_m={self.coarsest_gate_m}"
            )
        for name in ("grey_sigma", "settled", "common_px", "warp", "bend_share"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"odometry: {name}={getattr(self, name)} must be positive")


@dataclass(frozen=True)
class Aligned:
    """How the camera moved, and what speaks for it.

    Args:
        motion: T_target_source.
        covariance: (6, 6) of (x, y, z, rotation vector), axes of the target, m and rad.
        fitting: Share of the source's points off the floor that lie on the target's surfaces, of those
            that fall into its view.
        visible: Share of them that fall into its view.
        contradicting: Share of those in view that stand where the target saw nothing.
        error: Root mean square distance to the surfaces, in deviations.
    """

    motion: Pose3
    covariance: Float[np.ndarray, "6 6"]
    fitting: float
    visible: float
    contradicting: float
    error: float

    @property
    def overlap(self) -> float:
        """How well it lies: points that fit less those that contradict, unseen ones counting a little."""
        return (self.fitting - self.contradicting) * self.visible / (0.7 * self.visible + 0.3)


def align(
    target: Pyramid,
    source: Pyramid,
    starts: Sequence[Pose3] = (Pose3(),),
    config: AlignConfig | None = None,
) -> Aligned | None:
    """The motion between two images.

    Args:
        target: What is held still; its planes are made if they are not yet.
        source: What is moved.
        starts: Guesses of T_target_source; all are tried on the coarsest size, the one with the best overlap
            off the floor goes on.
        config: Method and limits.

    Returns:
        None where the images do not determine a motion.
    """
    config = config or AlignConfig()
    present = target.has_grey and source.has_grey and config.method == "hybrid"
    grey_sigma = config.grey_sigma if present else 0.0
    tried = [(0.0, start.matrix, np.array([grey_sigma, 0.0])) for start in starts]
    for number in range(len(source.levels) - 1, -1, -1):
        settled = []
        for _, T, light in tried:
            totals = _refine(target, source, number, T, config, light)
            settled.append((_overlap(totals), T, light))
        tried = _best(settled, config.kept if number > 1 else 1)
    _, T, light = tried[0]
    return judged(target, source, T, config, light)


_Try = tuple[float, np.ndarray, np.ndarray]


def _best(settled: list[_Try], most: int) -> list[_Try]:
    """The ones with the best overlap, best first, those that came to the same place only once."""
    kept: list[_Try] = []
    for one in sorted(settled, key=lambda one: -one[0]):
        if all(np.max(np.abs(one[1] - other[1])) > SAME for other in kept):
            kept.append(one)
        if len(kept) == most:
            break
    return kept


def judged(
    target: Pyramid,
    source: Pyramid,
    T: Float[np.ndarray, "4 4"],
    config: AlignConfig,
    light: Float[np.ndarray, "2"] | None = None,
) -> Aligned | None:
    """How well a motion fits, on the finest size, and how sure it is; None if it is not determined."""
    light = np.zeros(2) if light is None else light
    totals = _equations(target.levels[0], source.levels[0], T, config.finest_gate_m, light)
    if totals[kernels.GEOMETRIC_COUNT] < 6 * config.common_px:
        return None
    error = math.sqrt(totals[kernels.GEOMETRIC] / totals[kernels.GEOMETRIC_COUNT])
    information = np.zeros((6, 6))
    information[np.triu_indices(6)] = totals[:21]
    information += np.triu(information, 1).T
    alike = max(error, 1.0) ** 2 * config.common_px * information
    covariance = _covariance(
        information, T, alike + _bent(target.levels[0], source.levels[0], T, config)
    )
    if covariance is None:
        return None
    turned = math.acos(min(1.0, max(-1.0, (float(np.trace(T[:3, :3])) - 1.0) / 2.0)))
    warp = np.array([float(np.linalg.norm(T[:3, 3]))] * 3 + [turned] * 3) * config.warp
    covariance = covariance + np.diag(warp**2)
    fitting, visible, contradicting = _shares(totals)
    return Aligned(Pose3.from_matrix(T), covariance, fitting, visible, contradicting, error)


def _refine(
    target: Pyramid,
    source: Pyramid,
    number: int,
    T: np.ndarray,
    config: AlignConfig,
    light: np.ndarray,
) -> np.ndarray:
    """Settle T on one size; the gate is wide on the coarsest and narrows from there."""
    to, of = target.levels[number], source.levels[number]
    coarsest = number == len(source.levels) - 1
    least = config.finest_gate_m * 2.0**number
    totals = np.empty(kernels.TOTALS)
    kernels.refine(
        of.z, of.sigma, of.grey, of.counts, *of.slopes,
        to.packed, to.intrinsics, T,
        config.coarsest_gate_m if coarsest else least,
        least, light, 1, config.rounds[min(number, len(config.rounds) - 1)], config.settled, totals,
    )  # fmt: skip
    return totals


def _equations(to: Level, of: Level, T: np.ndarray, gate_m: float, light: np.ndarray) -> np.ndarray:
    totals = np.empty(kernels.TOTALS)
    kernels.equations(
        of.z, of.sigma, of.grey, of.counts, *of.slopes,
        to.packed, to.intrinsics, T, gate_m, light, 1, totals,
    )  # fmt: skip
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
    return Aligned(Pose3(), np.zeros((6, 6)), fitting, visible, contradicting, 0.0).overlap


def _bent(
    to: Level, of: Level, T: Float[np.ndarray, "4 4"], config: AlignConfig
) -> Float[np.ndarray, "6 6"]:
    """What depth that is bent over large parts of the image adds to the scatter of the gradient.

    The bend stays with the pixels: of two images from the same place both are bent alike, and nothing comes
    of it; what is seen by other pixels than before is bent otherwise.
    """
    side = config.bend_share * of.camera.width
    patches = math.ceil(of.camera.width / side) * math.ceil(of.camera.height / side)
    pulls = np.empty((patches, 6))
    moved = kernels.bends(
        of.z, of.sigma, *of.slopes, to.packed, to.intrinsics, T, config.finest_gate_m, side, pulls
    )  # fmt: skip
    unlike = 1.0 - math.exp(-0.5 * (moved / side) ** 2)
    return np.asarray(2.0 * unlike * config.bend**2 * pulls.T @ pulls)


def _covariance(
    information: np.ndarray, T: np.ndarray, scatter: np.ndarray
) -> Float[np.ndarray, "6 6"] | None:
    """Of (position, rotation vector) in the target's axes; the information is of a turn about its origin.

    Where errors of pixels are not independent, the scatter of the gradient is more than the information:
    the covariance is that of Huber's sandwich.
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
