"""The univector field: at every place a direction that leads to the goal and round the obstacles.

Three printed faults are mended: the sign and the heading increment in eq. (8) and the empty inner disc in eq. (9),
both kept as `literal`, and a third component in eq. (10) that has no partner and is left out. The printed weights
(0.75 to the goal) let the robot deep into obstacles; see `PUBLISHED` and `FieldConfig`.

Source: seed 001, section 4, eq. (7) to (10).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.errors import ConfigError
from perception.primitives.robot_model import DARWIN_OP

from . import _kernels


@dataclass(frozen=True)
class FieldConfig:
    """Shape of the field, weights of its parts, and what is added where obstacles move.

    Each addition has a switch of its own; with all four off it is the published field of eq. (7) to (10) with
    radii that grow with the speed alone. `motion.advise` reads them.

    Args:
        gaze_coupling: psi_sf + psi_ob enlarge S_oe (eq. 7) and the virtual obstacle (eq. 11).
        virtual_obstacles: A virtual obstacle on the path of a mover that no change of speed avoids (case c).
        velocity_change: Accelerate to pass before a mover, decelerate to pass behind, escape from its band.
        uncertainty: Deviations of place and velocity, the robot's own among them, enlarge S_oe and the band
            of colliding speeds.
    """

    w_goal: float = 0.25  # w_muf, own: seed 001 prints 0.75, which penetrates obstacles
    w_avoid: float = 0.75  # w_auf, own: seed 001 prints 0.25
    k_rho: float = 1.0  # own (specification)
    k_alpha: float = 1.0  # own (specification): 1 makes the field a function of the place alone
    k_beta: float = -1.0  # own (specification): -1 is the dipole field
    d_con_m: float = 1.0  # own (specification): from here on the arrival angle counts
    ramp: bool = (
        False  # ours: lets k_beta grow from 0 at d_con, so that the field has no jump there
    )
    d_e_m: float = 0.25  # own (specification): width of the band in which the field turns aside
    d_b_m: float = 0.30  # own (specification): further band in which it swings back
    k_r_m: float = 0.10  # K_r, own (specification)
    eta_v_s: float = 0.5  # w_soe eta_vo, own (specification): growth with the obstacle's speed
    eta_psi_m: float = 0.05  # w_soe eta_imp, own (specification): growth with the evaluations psi
    gaze_coupling: bool = True
    virtual_obstacles: bool = True
    velocity_change: bool = True
    uncertainty: bool = True
    convexity: float = 0.7  # xi, own (specification)
    virtual_v_s: float = 12.0  # w_dist eta_vo, own (specification)
    virtual_psi_m: float = 0.3  # w_dist eta_imp, own (specification)
    acceleration_mps2: float = 0.05  # own (specification)
    sigmas: float = 1.0  # ours: deviations that uncertainty adds
    max_sigma_m: float = 0.15  # ours, as the guard: more doubt than this would freeze the robot
    horizon_s: float = 8.0  # ours: collisions later than this are left to later steps

    def __post_init__(self) -> None:
        for name in (*("d_con_m", "d_e_m", "virtual_v_s", "acceleration_mps2", "horizon_s"),):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"field: {name}={value} must be positive and finite")
        for name in (
            *("w_goal", "w_avoid", "d_b_m", "k_r_m", "eta_v_s", "eta_psi_m"),
            *("virtual_psi_m", "sigmas", "max_sigma_m"),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"field: {name}={value} must be finite and not negative")
        if not 0.0 < self.convexity < 1.0:
            raise ConfigError(
                f"field: convexity={self.convexity} must lie in (0, 1); 0.5 is straight"
            )


PUBLISHED = FieldConfig(w_goal=0.75, w_avoid=0.25)
"""The weights as printed, for comparison."""


def extended_radius(
    radius_m: Float[np.ndarray, "n"],
    speed_mps: Float[np.ndarray, "n"],
    psi: Float[np.ndarray, "n"],
    config: FieldConfig,
    body_m: float = DARWIN_OP.radius_m,
) -> Float[np.ndarray, "n"]:
    """S_oe: how far the robot's middle stays from an obstacle's.

    Args:
        radius_m: S_o of each obstacle.
        speed_mps: Of each obstacle.
        psi: psi_sf + psi_ob, in [0, 2], from the gaze evaluations; zeros where not used.
        config: Growth with speed and importance.
        body_m: S_r of the robot.

    Returns:
        S_oe of each, m.

    Source: seed 001, eq. (7).
    """
    return body_m + radius_m + config.eta_v_s * speed_mps + config.eta_psi_m * psi


def move_to_goal(
    places: Float[np.ndarray, "n 2"],
    goal: Float[np.ndarray, "2"],
    goal_heading: float | None,
    config: FieldConfig,
    headings: Float[np.ndarray, "n"] | None = None,
    literal: bool = False,
) -> Float[np.ndarray, "n 2"]:
    """u_muf: straight to the goal, and within d_con on a curve that arrives with the wanted heading.

    Args:
        places: World frame, m.
        goal: p_d, world frame, m.
        goal_heading: th_tg, rad; None for any.
        config: Gains.
        headings: th_r, of a robot at each place, rad; matters only where k_alpha is not 1, or `literal`.
        literal: As printed: away from the goal, and an increment used as a direction.

    Returns:
        Vectors of length k_rho (1 in `literal`); zero at the goal itself.

    Source: seed 001, eq. (8).
    """
    none = np.empty((0, 2)), np.empty(0), None
    return _field(places, headings, goal, goal_heading, none, config, (1.0, 0.0), literal)


def avoid(
    places: Float[np.ndarray, "n 2"],
    goal: Float[np.ndarray, "2"],
    centres: Float[np.ndarray, "m 2"],
    extended_m: Float[np.ndarray, "m"],
    config: FieldConfig,
    literal: bool = False,
) -> Float[np.ndarray, "n 2"]:
    """N(sum u_auf): spirals round the obstacles on the side that is shorter to the goal.

    Args:
        places: World frame, m.
        goal: p_d, world frame, m.
        centres: Of the obstacles, world frame, m.
        extended_m: S_oe of each.
        config: Bands d_e and d_b, K_r.
        literal: As printed: nothing inside S_oe (default: straight out).

    Returns:
        Unit vectors; zero where no obstacle matters.

    Source: seed 001, eq. (9) and the normalisation in eq. (10).
    """
    obstacles = centres, extended_m, None
    return _field(places, None, goal, None, obstacles, config, (0.0, 1.0), literal)


def total(
    places: Float[np.ndarray, "n 2"],
    goal: Float[np.ndarray, "2"],
    goal_heading: float | None,
    centres: Float[np.ndarray, "m 2"],
    extended_m: Float[np.ndarray, "m"],
    config: FieldConfig,
    headings: Float[np.ndarray, "n"] | None = None,
    literal: bool = False,
    virtual: Bool[np.ndarray, "m"] | None = None,
) -> Float[np.ndarray, "n 2"]:
    """u_T = w_muf u_muf + w_auf N(sum u_auf), at one place or a whole picture.

    Where no obstacle matters the goal's part counts alone, with weight 1 (with w_muf in `literal`).

    Args: as for `move_to_goal` and `avoid`, and
        virtual: Which obstacles are virtual; they lie beside the robot by their nature, so that it makes no
            difference to them whether they lie ahead or beyond the goal. None: none is.

    Returns:
        Vectors; only their direction is meant.

    Source: seed 001, eq. (10).
    """
    weights = config.w_goal, config.w_avoid
    obstacles = centres, extended_m, virtual
    return _field(places, headings, goal, goal_heading, obstacles, config, weights, literal)


def _field(
    places: np.ndarray,
    headings: np.ndarray | None,
    goal: np.ndarray,
    goal_heading: float | None,
    obstacles: tuple[np.ndarray, np.ndarray, np.ndarray | None],
    config: FieldConfig,
    weights: tuple[float, float],
    literal: bool,
) -> np.ndarray:
    centres, radii, virtual = obstacles
    out = np.empty((len(places), 2))
    _kernels.field(
        np.ascontiguousarray(places, np.float64),
        np.zeros(len(places)) if headings is None else np.ascontiguousarray(headings, np.float64),
        float(goal[0]),
        float(goal[1]),
        0.0 if goal_heading is None else float(goal_heading),
        goal_heading is not None,
        np.ascontiguousarray(centres, np.float64),
        np.ascontiguousarray(radii, np.float64),
        np.zeros(len(radii), np.bool_) if virtual is None else np.ascontiguousarray(virtual),
        1.0 if literal else config.k_rho,
        config.k_alpha,
        config.k_beta,
        config.d_con_m,
        config.ramp,
        config.d_e_m,
        config.d_b_m,
        config.k_r_m,
        *weights,
        literal,
        out,
    )
    return out
