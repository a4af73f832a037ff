"""The log of a wheeled robot: odometry, and sightings of known landmarks or ranges to known beacons.

Source: ours.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import median_filter

from ..primitives.errors import InputError
from ..primitives.gaussian import Gaussian
from .planar import Journey

INTERVAL_S = 0.1  # ours: longest time between two instants
JUMP = 2.0  # ours: speed of a jump over the speeds of the log
AROUND = 7  # ours: steps whose median replaces a jump
AT_REST = 0.1  # ours: speed of a robot that stands, over the speeds of the log
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
"""Multiples of it modulo 1 are even and follow no period, as every k-th stamp would that of beacons asked in turn (Weyl sequence)."""
LEAST_S = 1e-3  # ours: a shorter step has no speed
LONGEST_GAP_S = 3600.0  # ours: between two rows of one log
LONGEST_S = 1e6  # ours: of a log; about 12 days
LAST_S = 1.67e10  # ours: in 2499; stamps in ms or ns are later
UNKNOWN = Gaussian(np.zeros(3), np.eye(3))
"""Start of a journey whose start nobody uses."""


@dataclass(frozen=True)
class PlanarLog:
    """A log without any pose.

    Args:
        stamps_s: (n,) of the odometry, increasing.
        totals: (n, 2) path, m, and turn, rad, since the first stamp.
        seen_s: (r,) stamps of the sightings, increasing.
        marks: (r,) index of the landmark into `places`.
        seen: (r, 2) depth, m, and bearing, rad; or range, m, and NaN.
        places: (l, 2) positions of the landmarks, m, world frame.
    """

    stamps_s: Float[np.ndarray, "n"]
    totals: Float[np.ndarray, "n 2"]
    seen_s: Float[np.ndarray, "r"]
    marks: Int[np.ndarray, "r"]
    seen: Float[np.ndarray, "r 2"]
    places: Float[np.ndarray, "l 2"]

    def __post_init__(self) -> None:
        if len(self.stamps_s) < 2 or len(self.seen_s) == 0:
            raise InputError(
                f"log: {len(self.stamps_s)} rows of odometry and {len(self.seen_s)} sightings of known "
                "landmarks; at least two and one are needed"
            )
        if np.any(np.diff(self.stamps_s) < 0.0) or np.any(np.diff(self.seen_s) < 0.0):
            raise InputError(
                "log: stamps go back in time; sort odometry and sightings by their stamps"
            )
        start, end = self.stamps_s[[0, -1]]
        gap = float(np.diff(self.stamps_s).max())
        if not (end <= LAST_S and end - start <= LONGEST_S and gap <= LONGEST_GAP_S):
            raise InputError(
                f"log: odometry from {start:.10g} to {end:.10g} s, with gaps up to {gap:.10g} s; at most {LONGEST_S:g} s "
                f"without gaps over {LONGEST_GAP_S:g} s were expected, before the year 2500. The stamps are in another "
                "unit than s, or the clock was set: correct them"
            )

    def without_jumps(self) -> PlanarLog:
        """The log with every jump of its odometry replaced by the median of the steps around it.

        A jump is faster than `JUMP` times all but a hundredth of the steps in motion.
        """
        dt, moved = np.diff(self.stamps_s), np.diff(self.totals, axis=0)
        rates = moved / np.maximum(dt, LEAST_S)[:, None]
        for column, speeds in enumerate(np.abs(rates).T):
            if not np.any(speeds > 0.0):
                continue
            jumps = speeds > JUMP * np.percentile(speeds[speeds > 0.0], 99.0)
            usual = median_filter(rates[:, column], AROUND)
            moved[jumps, column] = (usual * dt)[jumps]
        totals = np.cumsum(np.vstack([self.totals[:1], moved]), axis=0)
        return dataclasses.replace(self, totals=totals)

    def first_part(self, begin_s: float, sightings: int, seconds: float, most: int) -> PlanarLog:
        """The log with only the first sightings after a stamp.

        Args:
            begin_s: The stamp, s.
            sightings: At least so many while the robot moves.
            seconds: And at least so much time in which it moves, s.
            most: Of more sightings about as many are kept, whole stamps of them, evenly in time and over the landmarks.
        """
        dt = np.diff(self.stamps_s)
        speeds = np.abs(np.diff(self.totals, axis=0)) / np.maximum(dt, LEAST_S)[:, None]
        moves = np.any(speeds > AT_REST * np.percentile(speeds, 90.0, axis=0), axis=1)
        moved_s = np.cumsum(np.where(moves & (self.stamps_s[1:] > begin_s), dt, 0.0))
        rows = np.flatnonzero((self.seen_s >= begin_s) & (self.seen_s <= self.stamps_s[-1]))
        seen_s = self.seen_s[rows]
        step = np.clip(np.searchsorted(self.stamps_s[1:], seen_s), 0, len(dt) - 1)
        enough = (np.cumsum(moves[step]) >= sightings) & (moved_s[step] >= seconds)
        if enough.any():
            rows = rows[seen_s <= seen_s[np.argmax(enough)]]
        _, number = np.unique(self.seen_s[rows], return_inverse=True)
        rows = rows[(number * GOLDEN) % 1.0 * len(rows) < most]
        return dataclasses.replace(
            self, seen_s=self.seen_s[rows], marks=self.marks[rows], seen=self.seen[rows]
        )

    def instants(self) -> Float[np.ndarray, "k"]:
        """Stamps of the sightings during the odometry, and of a regular grid."""
        start, end = float(self.stamps_s[0]), float(self.stamps_s[-1])
        inside = self.seen_s[(self.seen_s >= start) & (self.seen_s <= end)]
        return np.unique(np.append(inside, np.arange(start, end, INTERVAL_S)))

    def journey(
        self, delay_s: float = 0.0, instants: Float[np.ndarray, "k"] | None = None
    ) -> Journey:
        """Input of the filter.

        Args:
            delay_s: The body moves this many seconds after its odometry.
            instants: Stamps, with those of all sightings between the first and the last; None: `instants`.
        """
        instants = self.instants() if instants is None else instants
        at = np.append(instants[0], instants)
        moved = [np.interp(at - delay_s, self.stamps_s, total) for total in self.totals.T]
        steps = np.stack([np.diff(at), *(np.diff(total) for total in moved)], axis=-1)
        inside = (self.seen_s >= instants[0]) & (self.seen_s <= instants[-1])
        first = np.append(np.searchsorted(self.seen_s[inside], instants), int(np.sum(inside)))
        return Journey(
            UNKNOWN,
            steps,
            first.astype(np.int64),
            self.marks[inside].astype(np.int64),
            np.ascontiguousarray(self.seen[inside]),
            self.places,
        )
