"""FAMS, the fuzzy selection of a motion from the width of the obstacle and that of the gap beside it.

Each input belongs to five overlapping sets. Table 2 names the motion of each pair. The strength of a motion is that of its
strongest rule, and the strongest motion is selected. The printed average of labels (`ordinal`) is kept for comparison:
between "stop" (1) and "turn and walk" (7) it gives "rotate" (4).

Source: Kang 2013 (seed 004), eq. (23) to (27), Table 2; the membership functions are lost, their centres are ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from perception.primitives.errors import ConfigError
from perception.primitives.robot_model import DARWIN_OP
from perception.primitives.settings import setting

MOTIONS = ("ST", "SS", "SF", "RS", "RF", "TS", "TF")  # C1 to C7, eq. (24)
SETS = ("NL", "NS", "Z", "PS", "PL")  # A1 to A5 and B1 to B5

TABLE = np.array(
    [
        [0, 1, 2, 2, 2],
        [0, 1, 2, 2, 2],
        [0, 3, 4, 4, 4],
        [0, 3, 4, 4, 4],
        [0, 5, 6, 6, 6],
    ]
)
"""Table 2: rows by obstacle, columns by gap; the printed "PX" is PS and "M" is TS."""


@dataclass(frozen=True)
class FamsConfig:
    """Membership functions: triangles with shoulders, given by their peaks."""

    obstacle_centres_m: tuple[float, ...] = (
        -0.20,
        0.0,
        0.40,
        0.70,
        1.00,
    )  # ours; lost in seed 004; peaks of the sets of obstacle width minus body width
    gap_centres_m: tuple[float, ...] = (
        -0.15,
        -0.05,
        0.05,
        0.25,
        0.50,
    )  # ours; lost in seed 004; peaks of the sets of gap width minus body width
    caution_sigmas: float = setting(
        0.5,
        "",
        "standard deviations by which a gap is narrowed before it is walked through",
        "ours",
    )
    ordinal: bool = setting(
        False, "", "select by the average of the labels 1 to 7, as printed", "seed 004, eq. (26)"
    )

    def narrowest_m(self, body_width_m: float) -> float:
        """The width from which a gap counts as passable sideways, m."""
        none, slip = self.gap_centres_m[:2]
        return body_width_m + (none + slip) / 2.0

    def __post_init__(self) -> None:
        for name in ("obstacle_centres_m", "gap_centres_m"):
            centres = getattr(self, name)
            if len(centres) != len(SETS) or not np.all(np.diff(centres) > 0.0):
                raise ConfigError(
                    f"fams: {name}={centres} must be {len(SETS)} rising numbers, one for each of NL to PL"
                )
        if self.caution_sigmas < 0.0:
            raise ConfigError(f"fams: caution_sigmas={self.caution_sigmas} must not be negative")


def memberships(
    values: Float[np.ndarray, "n"], centres: tuple[float, ...]
) -> Float[np.ndarray, "5 n"]:
    """Membership of each value in each set: triangles that sum to 1, with shoulders at both ends.

    Args:
        values: m.
        centres: Peaks of the sets, rising, m.
    """
    degrees = np.zeros((len(centres), len(values)))
    before = np.ones(len(values))
    for k in range(len(centres) - 1):
        share = (values - centres[k]) / (centres[k + 1] - centres[k])
        rising = np.minimum(np.maximum(share, 0.0), 1.0)
        degrees[k] = before - rising
        before = rising
    degrees[-1] = before
    return degrees


def strengths(
    width_m: Float[np.ndarray, "n"],
    gap_m: Float[np.ndarray, "n"],
    config: FamsConfig,
    gap_sigma_m: Float[np.ndarray, "n"] | None = None,
    body_width_m: float = DARWIN_OP.passage_width_m,
) -> Float[np.ndarray, "7 n"]:
    """f_m: strength of each motion in [0, 1], in the order of `MOTIONS`.

    Args:
        width_m: w_l of the obstacles ahead.
        gap_m: s_l on the chosen side; negative where neighbours overlap.
        config: Membership functions.
        gap_sigma_m: Standard deviation of the gap; None: exact. An uncertain gap counts as narrower in the choice
            between walking and side steps, but not in the choice to stop.
        body_width_m: w_r of the robot.

    Source: seed 004, eq. (23), (25) to (27); the maximum over the rules of a motion is ours.
    """
    wide = memberships(width_m - body_width_m, config.obstacle_centres_m)
    spare = gap_m - body_width_m  # eq. (23), both
    if gap_sigma_m is not None:
        sideways = config.gap_centres_m[1]
        surely = np.maximum(spare - config.caution_sigmas * gap_sigma_m, sideways)
        spare = np.where(spare > sideways, surely, spare)
    free = memberships(spare, config.gap_centres_m)
    found = np.zeros((len(MOTIONS), len(width_m)))
    for motion in range(len(MOTIONS)):
        rows, columns = np.nonzero(np.equal(TABLE, motion))
        rows, columns = np.unique(rows), np.unique(columns)  # a motion fills a rectangle of Table 2
        fires = np.minimum(wide[rows].max(axis=0), free[columns].max(axis=0))  # eq. (27)
        found[motion] = fires
    return found


def select(
    width_m: Float[np.ndarray, "n"],
    gap_m: Float[np.ndarray, "n"],
    config: FamsConfig | None = None,
    gap_sigma_m: Float[np.ndarray, "n"] | None = None,
    body_width_m: float = DARWIN_OP.passage_width_m,
) -> Int[np.ndarray, "n"]:
    """The index in `MOTIONS` of the motion for each pair; arguments as of `strengths`.

    With `ordinal` the standard deviation of the gap is not used.

    Source: seed 004, eq. (26) and Table 2.
    """
    config = FamsConfig() if config is None else config
    if config.ordinal:
        return _ordinal(width_m, gap_m, config, body_width_m)
    return np.asarray(
        np.argmax(strengths(width_m, gap_m, config, gap_sigma_m, body_width_m), axis=0)
    )


def _ordinal(
    width_m: Float[np.ndarray, "n"],
    gap_m: Float[np.ndarray, "n"],
    config: FamsConfig,
    body_width_m: float,
) -> Int[np.ndarray, "n"]:
    """The label nearest to the average of the active labels, weighted by their strengths."""
    wide = memberships(width_m - body_width_m, config.obstacle_centres_m)
    free = memberships(gap_m - body_width_m, config.gap_centres_m)
    fires = np.minimum(wide[:, None], free[None, :])
    mean = np.einsum("ijn,ij->n", fires, TABLE.astype(float)) / fires.sum(axis=(0, 1))
    return np.floor(mean + 0.5).astype(np.int64)
