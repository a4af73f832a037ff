"""Compiled loops of the world map: what one frame says about each cell, and what all frames say together.

See `world_map`; NumPy versions are in the tests.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from perception.primitives.compiled import njit

from ._terrain_kernels import Placement, form

LOGISTIC = 1.702  # slope of the logistic function closest to the normal distribution; Camilli 1994
MEAN_ABSOLUTE = math.sqrt(2.0 / math.pi)  # of a normal error, in standard deviations
FARTHEST_SHARE = 0.8  # of the points of a cell that a large error carries into its four neighbours


class LookRule(NamedTuple):
    """How a look is judged.

    Args:
        obstacle_points: Fewer obstacle points in a cell are noise.
        memory: Looks that a cell remembers.
        moving: Log-odds of a cell with a moving obstacle.
    """

    obstacle_points: int
    memory: float
    moving: float


class Shares(NamedTuple):
    """Beta distributions of the share of obstacle looks, of an occupied cell and of a free one."""

    occupied_a: float
    occupied_b: float
    free_a: float
    free_b: float


@njit(cache=True)
def log_odds_of(looks: float, hits: float, shares: Shares) -> float:
    """Log-odds that a cell with `hits` obstacle looks of `looks` is occupied: two beta-binomials compared."""
    return log_beta_binomial(looks, hits, shares.occupied_a, shares.occupied_b) - log_beta_binomial(
        looks, hits, shares.free_a, shares.free_b
    )


@njit(cache=True)
def log_beta_binomial(n: float, k: float, a: float, b: float) -> float:
    """Logarithm of B(k + a, n - k + b) / B(a, b)."""
    return (
        math.lgamma(k + a)
        + math.lgamma(n - k + b)
        - math.lgamma(n + a + b)
        - math.lgamma(a)
        - math.lgamma(b)
        + math.lgamma(a + b)
    )


@njit(cache=True)
def judge(
    counts: np.ndarray,
    sums: np.ndarray,
    place: Placement,
    camera: np.ndarray,
    rule: LookRule,
    verdicts: np.ndarray,
    weights: np.ndarray,
) -> None:
    """The verdict of a frame on each cell, and the weight of this look; sigmas become those of heights.

    Depth noise carries points along their rays into the next cell. A wall somewhere in the fullest neighbour
    leaves the share r of the neighbour's points here with density sigma / (1.702 c r), where c is the side of a
    cell and sigma the noise towards the neighbour; any share is as likely if the points belong here. If they do
    not, they say nothing, and floor points speak.

    Args:
        counts: (3, rows, columns) int32 of the window.
        sums: (3 rows columns + 1, 3), of `gather` with the standard deviations along the rays; changed.
        place: The window.
        camera: (3,) position in the world, height above the floor, m.
        rule: See there.
        verdicts: (rows, columns) float32, out: probability that the look shows an obstacle.
        weights: Same shape, out: 0 where there is no look.
    """
    rows, columns = counts.shape[1], counts.shape[2]
    cells = rows * columns
    for row in range(rows):
        for column in range(columns):
            verdicts[row, column] = weights[row, column] = 0.0
            flat = row * columns + column
            x = place.x_m + (column + 0.5) * place.cell_m - camera[0]
            y = place.y_m + (row + 0.5) * place.cell_m - camera[1]
            across2 = x * x + y * y
            noise2 = 0.0  # of the obstacle points, per squared distance
            for kind in range(3):
                count, entry = counts[kind, row, column], kind * cells + flat
                if count == 0:
                    continue
                drop2 = (sums[entry, 0] / count - camera[2]) ** 2
                level = across2 / max(across2 + drop2, 1e-12)
                if kind == 1:
                    noise2 = sums[entry, 2] / count / max(across2 + drop2, 1e-12)
                sums[entry, 2] *= 1.0 - level
            floor, static, mobile = (
                counts[0, row, column],
                counts[1, row, column],
                counts[2, row, column],
            )
            if static >= rule.obstacle_points:
                most, towards = static, 0.0
                for r in range(max(row - 1, 0), min(row + 2, rows)):
                    for c in range(max(column - 1, 0), min(column + 2, columns)):
                        if counts[1, r, c] > most:
                            most = counts[1, r, c]
                            along = x * (c - column) + y * (r - row)
                            towards = abs(along) / math.hypot(c - column, r - row)
                reach = math.sqrt(noise2) * towards / place.cell_m
                own = static / (static + most * reach / LOGISTIC)
                weights[row, column] = 1.0 if floor > 0 else own
                verdicts[row, column] = own if floor > 0 else 1.0
            elif static + mobile < rule.obstacle_points and floor != 0:
                weights[row, column] = 1.0


@njit(cache=True)
def blurred(
    verdicts: np.ndarray, weights: np.ndarray, row: int, column: int, share: float
) -> float:
    """The expected verdict on a cell if its points may belong to its four neighbours, with a probability."""
    total, seen = 0.0, 0
    for dr, dc in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        r, c = row + dr, column + dc
        if 0 <= r < verdicts.shape[0] and 0 <= c < verdicts.shape[1] and weights[r, c] > 0.0:
            total += verdicts[r, c]
            seen += 1
    here = float(verdicts[row, column])
    return here if seen == 0 else (1.0 - share) * here + share * total / seen


@njit(cache=True)
def fold_looks(
    counts: np.ndarray,
    verdicts: np.ndarray,
    weights: np.ndarray,
    layers: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    frames: tuple[np.ndarray, np.ndarray],
    place: Placement,
    pose_form: np.ndarray,
    stamp_s: float,
    rule: LookRule,
    shares: Shares,
) -> None:
    """Add the looks of a frame to the map; each cell changes at most once.

    Args:
        counts: (3, rows, columns) int32 of the window.
        verdicts, weights: Of `judge`.
        layers: Looks, obstacle looks, log-odds (+inf where never seen), time of the last update in s, and
            whether the obstacle in the cell moves; all of the map; changed.
        frames: int32, number of frames with floor points and with obstacle points in each cell; changed.
        place: The window.
        pose_form: (3, 3), variance of a place along one axis at (x, y, 1), m^2.
        stamp_s: Time of the frame, s.
        rule, shares: See there.
    """
    looks, hits, log_odds, updated_s, moving = layers
    with_floor, with_obstacle = frames
    for row in range(counts.shape[1]):
        r = place.row + row
        for column in range(counts.shape[2]):
            c = place.column + column
            weight = weights[row, column]
            static, mobile = counts[1, row, column], counts[2, row, column]
            with_floor[r, c] += counts[0, row, column] > 0
            with_obstacle[r, c] += static + mobile > 0
            if weight == 0.0 and (
                static >= rule.obstacle_points or static + mobile < rule.obstacle_points
            ):
                continue
            updated_s[r, c] = stamp_s
            if weight == 0.0:  # a moving obstacle has just arrived: earlier looks do not apply
                looks[r, c] = hits[r, c] = 0.0
                log_odds[r, c] = rule.moving
                moving[r, c] = True
                continue
            x = place.x_m + (column + 0.5) * place.cell_m
            y = place.y_m + (row + 0.5) * place.cell_m
            error = MEAN_ABSOLUTE * math.sqrt(max(form(pose_form, x, y), 0.0)) / place.cell_m
            share = min(FARTHEST_SHARE, 1.0 - (1.0 - min(error, 1.0)) ** 2)
            n = looks[r, c] + weight
            k = hits[r, c] + weight * blurred(verdicts, weights, row, column, share)
            fade = min(1.0, rule.memory / n)
            looks[r, c], hits[r, c] = n * fade, k * fade
            log_odds[r, c] = log_odds_of(n * fade, k * fade, shares)
            moving[r, c] = False
