"""The univector field: at every position a direction that leads to the goal and round the obstacles.

Three printed errors are corrected: the sign and the heading increment in eq. (8) and the undefined inner disc in
eq. (9), both kept as `literal`, and a third component in eq. (10) without a counterpart, which is left out. With the
printed weights (0.75 to the goal) the robot enters obstacles; see `PUBLISHED` and `FieldConfig`.

Source: Yoo 2010 (seed 001), section 4, eq. (7) to (10).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.robot_model import DARWIN_OP, GaitLimits
from perception.primitives.settings import setting

from . import _kernels

K_R_M = 0.10  # K_r; ours
TO_CRUISE_S = 1.4  # ours: from standing to cruising speed at the largest change of speed
SIGMAS = 1.0  # ours: standard deviations that uncertainty adds ...
MAX_SIGMA_M = 0.15  # ours: ... each at most this; more would freeze the robot
HORIZON_S = 8.0  # ours: later collisions are left to later steps

MODES = ("ours", "seed", "printed")


@dataclass(frozen=True)
class FieldConfig:
    """Weights and bands of the field, and its additions for moving obstacles.

    Each addition has a switch. With all four off the field is that of eq. (7) to (10), with radii that grow with the
    speed alone. `motion.advise` applies the additions.

    Args:
        mode: "ours": the values below. "seed": the motion of seed 001 with its misprints corrected, that is gaze
            evaluations, virtual obstacles and the printed change of speed, an arrival heading at every via point, and
            no guard; planner "field" only. "printed": the same with the printed weights.
    """

    mode: str = setting(
        "ours", "", "ours, seed or printed: which motion the planner field walks by", "ours"
    )
    w_goal: float = setting(
        0.25, "", "weight w_muf of the direction to the goal", "ours; seed 001: 0.75 hits obstacles"
    )
    w_avoid: float = setting(
        0.75, "", "weight w_auf of the direction round obstacles", "ours; seed 001: 0.25"
    )
    d_con_m: float = setting(
        1.0, "m", "distance to the goal within which the arrival heading counts", "ours"
    )
    d_e_m: float = setting(
        0.25, "m", "width of the band round an obstacle in which the field turns aside", "ours"
    )
    d_b_m: float = setting(0.30, "m", "width of the next band, in which it turns back", "ours")
    eta_v_s: float = setting(
        0.5, "s", "growth w_soe eta_vo of the radius with the speed of an obstacle", "ours"
    )
    eta_psi_m: float = setting(
        0.05, "m", "growth w_soe eta_imp of the radius with the gaze evaluations", "ours"
    )
    gaze_coupling: bool = setting(
        True, "", "gaze evaluations enlarge obstacles and virtual obstacles", "seed 001, eq. (7)"
    )
    virtual_obstacles: bool = setting(
        True, "", "virtual obstacles ahead of obstacles that no speed avoids", "seed 001, eq. (11)"
    )
    velocity_change: bool = setting(
        True, "", "the speed changes to pass before or behind moving obstacles", "seed 001"
    )
    uncertainty: bool = setting(
        True, "", "standard deviations enlarge radii and colliding speeds", "ours"
    )
    convexity: float = setting(
        0.7, "", "xi: how fast a virtual obstacle shrinks with distance", "ours; 0.5: linearly"
    )

    @property
    def as_walked(self) -> FieldConfig:
        """The settings with those that the mode implies."""
        if self.mode == "ours":
            return self
        goal, avoid = (0.75, 0.25) if self.mode == "printed" else (0.25, 0.75)
        return replace(
            self,
            w_goal=goal,
            w_avoid=avoid,
            gaze_coupling=True,
            virtual_obstacles=True,
            velocity_change=True,
            uncertainty=False,
        )

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ConfigError(f"field: mode={self.mode!r} is unknown; choose {', '.join(MODES)}")
        for name in ("d_con_m", "d_e_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"field: {name}={value} must be positive and finite")
        for name in ("w_goal", "w_avoid", "d_b_m", "eta_v_s", "eta_psi_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"field: {name}={value} must be finite and not negative")
        if not 0.0 < self.convexity < 1.0:
            raise ConfigError(
                f"field: convexity={self.convexity} must lie in (0, 1); 0.5 is straight"
            )


PUBLISHED = FieldConfig(w_goal=0.75, w_avoid=0.25)
"""The printed weights, for comparison."""


def acceleration_mps2(gait: GaitLimits) -> float:
    """Largest change of speed of a robot, m/s^2: 0.05 for a DARwIn-OP.

    Source: ours.
    """
    return gait.cruise_mps / TO_CRUISE_S


def extended_radius(
    radius_m: Float[np.ndarray, "n"],
    speed_mps: Float[np.ndarray, "n"],
    psi: Float[np.ndarray, "n"],
    config: FieldConfig,
    body_m: float = DARWIN_OP.radius_m,
) -> Float[np.ndarray, "n"]:
    """S_oe: distance that the middle of the robot keeps from that of an obstacle.

    Args:
        radius_m: S_o of each obstacle, m.
        speed_mps: Of each obstacle, m/s.
        psi: psi_sf + psi_ob of each, in [0, 2]; zeros if not used.
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
    """u_muf: straight to the goal, and within d_con on a curve that arrives with the desired heading.

    Args:
        places: World frame, m.
        goal: p_d, world frame, m.
        goal_heading: th_tg, rad; None for any.
        config: d_con.
        headings: th_r of the robot at each place, rad; used in `literal` only.
        literal: As printed: away from the goal, with an increment used as a direction.

    Returns:
        Unit vectors; zero at the goal.

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
    """N(sum u_auf): spirals round the obstacles, on the shorter side to the goal.

    Args:
        places: World frame, m.
        goal: p_d, world frame, m.
        centres: Of the obstacles, world frame, m.
        extended_m: S_oe of each.
        config: Bands d_e and d_b.
        literal: As printed: zero inside S_oe (default: radially outwards).

    Returns:
        Unit vectors; zero out of range of all obstacles.

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
    virtual: Float[np.ndarray, "m"] | None = None,
) -> Float[np.ndarray, "n 2"]:
    """u_T = w_muf u_muf + w_auf N(sum u_auf), at any number of places.

    Out of range of all obstacles u_muf counts alone, with weight 1 (with w_muf in `literal`). Where virtual obstacles
    count alone, their largest weight leads from there to the weights of eq. (10).

    Args: as for `move_to_goal` and `avoid`, and
        virtual: Weight of each virtual obstacle, in (0, 1], 0 for a real one. A virtual one counts also behind the
            robot or beyond the goal. None: none is virtual.

    Returns:
        Vectors of which only the direction is meaningful.

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
        _kernels.Discs(
            np.ascontiguousarray(centres, np.float64),
            np.ascontiguousarray(radii, np.float64),
            np.zeros(len(radii)) if virtual is None else np.ascontiguousarray(virtual, np.float64),
        ),
        _kernels.Shape(config.d_con_m, config.d_e_m, config.d_b_m, K_R_M, *weights, literal),
        out,
    )
    return out
