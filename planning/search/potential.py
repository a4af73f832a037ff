"""The repulsive potential of a cell, and the cells that the body cannot enter.

Two forms fit the preserved text. The smooth one is p (1 - E/E0)^2, in [0, 1]. Khatib's is p (1/E - 1/E0)^2, in 1/m^2, 1344
at the cell itself and 0.4 at 5 cm from the margin; times r_b^2 it equals the smooth form at the body radius, so that one
weight alpha serves both.

Source: seed 003, section 3 ("U(k,k')", equation lost); Khatib 1986 for the second form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from mapping.grid.evidence import OCCUPIED
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.robot_model import DARWIN_OP, RobotModel
from perception.primitives.settings import setting

from . import _potential_kernels as kernels

MOST_MARGIN_M = 5.0  # ours: cells within it are visited one by one
FORMS = ("smooth", "khatib")


@dataclass(frozen=True)
class SearchConfig:
    """Margins of the potential and weights of the search."""

    form: str = setting("smooth", "", "form of the potential: smooth or khatib", "ours")
    margin_m: float = setting(
        0.30,
        "m",
        "distance E0 within which an obstacle adds cost, for a DARwIn-OP; grows with the body",
        "ours",
    )
    alpha: float = setting(5.0, "", "weight of the potential per metre of path", "ours")
    p_unknown: float = 0.5  # ours; probability of occupancy of unseen cells
    p_solid: float = setting(
        OCCUPIED, "", "probability from which a known cell blocks the body", "ours"
    )
    literal: bool = False  # rank nodes by their own potential only; not optimal, for comparison

    def __post_init__(self) -> None:
        if self.form not in FORMS:
            raise ConfigError(f"search: form={self.form!r} is unknown; choose {', '.join(FORMS)}")
        if not 0.0 < self.margin_m <= MOST_MARGIN_M:
            raise ConfigError(
                f"search: margin_m={self.margin_m} must be a positive length in m, at most {MOST_MARGIN_M:g}"
            )
        if not (math.isfinite(self.alpha) and self.alpha >= 0.0):
            raise ConfigError(f"search: alpha={self.alpha} must be finite and not negative")
        if not 0.0 <= self.p_unknown <= 1.0:
            raise ConfigError(f"search: p_unknown={self.p_unknown} must be a probability in [0, 1]")
        if not 0.0 < self.p_solid <= 1.0:
            raise ConfigError(
                f"search: p_solid={self.p_solid} must lie in (0, 1]; with 0 every known cell would block"
            )


BODY_M = 0.16  # r_b; ours: radius of a DARwIn-OP
START_M = 0.35  # ours: unseen cells within this distance of a DARwIn-OP count as free


class Reach(NamedTuple):
    """Lengths of the search for one robot, m.

    Args:
        body_m: r_b, within which an obstacle blocks a cell.
        margin_m: E0, within which it costs.
        start_m: Radius round the start within which unseen cells count as free.
        turn_m: Turning radius of the walk: a cruising step by the largest turn in one.
    """

    body_m: float
    margin_m: float
    start_m: float
    turn_m: float

    @staticmethod
    def of(config: SearchConfig, robot: RobotModel) -> Reach:
        """The lengths tuned on a DARwIn-OP, scaled to this robot, and its turning radius."""
        wide, gait = robot.breadth, robot.gait
        turn_m = gait.cruise_mps * gait.step_s / gait.max_turn_rad
        return Reach(wide * BODY_M, wide * config.margin_m, wide * START_M, turn_m)


def repulsion(
    distance_m: Float[np.ndarray, "*n"],
    cell_m: float,
    config: SearchConfig,
    robot: RobotModel = DARWIN_OP,
) -> Float[np.ndarray, "*n"]:
    """Potential of a certain obstacle (p = 1) at a distance, without unit.

    Smooth: (1 - E / E0)^2, in [0, 1]. Khatib: r_b^2 (1 / max(E, S_c / 2) - 1 / E0)^2. Both are 0 from E0 on.

    Args:
        distance_m: E, from the middle of the cell of the obstacle, m.
        cell_m: S_c.
        config: Form and E0.
        robot: Scale of the lengths.

    Source: seed 003, section 3.
    """
    reach = Reach.of(config, robot)
    if config.form == "khatib":
        strength = reach.body_m * (1.0 / np.maximum(distance_m, cell_m / 2) - 1.0 / reach.margin_m)
    else:
        strength = 1.0 - distance_m / reach.margin_m
    return np.where(distance_m < reach.margin_m, strength**2, 0.0)


def potential(
    probability: Float[np.ndarray, "rows columns"],
    cell_m: float,
    config: SearchConfig,
    robot: RobotModel = DARWIN_OP,
) -> Float[np.ndarray, "rows columns"]:
    """U(k) = max over k' of p(k') times the repulsion at E(k, k').

    Args:
        probability: p of an obstacle in the cell; cells outside the grid count as free.
        cell_m: Side of a cell.
        config: Form and E0.
        robot: Scale of the lengths.

    Source: seed 003, section 3.
    """
    nothing = np.zeros(probability.shape, np.bool_)
    return _spread(probability, nothing, cell_m, config, robot)[0]


def terrain(
    probability: Float[np.ndarray, "rows columns"],
    unknown: Bool[np.ndarray, "rows columns"],
    cell_m: float,
    config: SearchConfig,
    robot: RobotModel = DARWIN_OP,
) -> tuple[Float[np.ndarray, "rows columns"], Bool[np.ndarray, "rows columns"]]:
    """Potential and blocked cells of a map with unseen cells.

    Unseen cells have p_unknown in the potential and never block.

    Raises:
        InputError: The maps differ in shape, cell_m is not positive, or a probability is not in [0, 1].

    Source: seed 003, section 3 (unknown cells) and ambiguity 1.
    """
    if probability.shape != unknown.shape or min(probability.shape) < 2:
        raise InputError(
            f"search: maps of {probability.shape} and {unknown.shape} cells; expected two of one shape, "
            "2x2 at least"
        )
    if not (math.isfinite(cell_m) and cell_m > 0.0):
        raise InputError(f"search: cell_m={cell_m} must be a positive length in m")
    filled = np.where(unknown, config.p_unknown, probability)
    least, most = filled.min(), filled.max()
    if not (least >= 0.0 and most <= 1.0):
        raise InputError(
            f"search: probabilities from {least} to {most}, expected [0, 1] without NaN"
        )
    return _spread(filled, ~unknown & (filled >= config.p_solid), cell_m, config, robot)


def _spread(
    probability: np.ndarray,
    solid: np.ndarray,
    cell_m: float,
    config: SearchConfig,
    robot: RobotModel,
) -> tuple[np.ndarray, np.ndarray]:
    return kernels.spread(
        np.ascontiguousarray(probability, np.float64),
        np.ascontiguousarray(solid),
        *_quarter(cell_m, config, robot),
    )


@cache
def _quarter(
    cell_m: float, config: SearchConfig, robot: RobotModel
) -> tuple[np.ndarray, np.ndarray]:
    """Repulsion of the cell (down, right) of the middle, and whether it blocks the middle; one of four quarters."""
    lengths = Reach.of(config, robot)
    reach = math.ceil(max(lengths.margin_m, lengths.body_m) / cell_m)
    along = np.arange(reach + 1) * cell_m
    distance = np.hypot(along[:, None], along)
    near = distance <= lengths.body_m * (1.0 + 1e-9)  # exactly at r_b counts in spite of rounding
    return repulsion(distance, cell_m, config, robot), near
