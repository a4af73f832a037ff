"""Whether measurements of the same thing agree, over the last few of them.

One innovation beyond its covariance is an outlier; several in a row to the same side are a fault. Source: Bar-Shalom,
Li, Kirubarajan (2001), section 5.4: time-averaged tests of innovations; the windows are ours.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from jaxtyping import Float

from ..filtering.consistency import chi_square_quantile

DISAGREE, AGREE = 0.9999, 0.9  # ours: probability at which a doubt begins, and at which it ends


class Bias:
    """Tests whether the innovations of a window have a common bias."""

    def __init__(self, degrees: int, window: int, agrees: bool = True) -> None:
        """Begin without innovations.

        Args:
            degrees: Entries of an innovation.
            window: Number of innovations that are summed.
            agrees: Whether all is well at first.
        """
        self._recent: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=window)
        self._limits = [chi_square_quantile(one, degrees) for one in (DISAGREE, AGREE)]
        self.agrees = agrees

    def update(
        self, innovation: Float[np.ndarray, "d"], covariance: Float[np.ndarray, "d d"]
    ) -> bool:
        """Take in an innovation with its covariance; whether all is well."""
        self._recent.append((innovation, covariance))
        total = self.total
        spread = np.sum([P for _, P in self._recent], axis=0)
        squared = float(total @ np.linalg.solve(spread, total))
        begin, end = self._limits
        self.agrees = squared <= (begin if self.agrees else end)
        return self.agrees

    @property
    def full(self) -> bool:
        """Whether the window has all its innovations."""
        return len(self._recent) == self._recent.maxlen

    @property
    def total(self) -> Float[np.ndarray, "d"]:
        """Sum of the innovations in the window."""
        return np.asarray(np.sum([one for one, _ in self._recent], axis=0))


class Surprise:
    """Tests whether the innovations of a window are larger than their covariances."""

    def __init__(self, degrees: int, window: int) -> None:
        """Begin without innovations; arguments as for `Bias`."""
        self._degrees = degrees
        self._recent: deque[tuple[float, int]] = deque(maxlen=window)
        self.agrees = True
        self.factor = 1.0
        """By how much the covariances of the window are too small; 1 while all is well."""

    def update(self, nis: float, joint: int = 1) -> bool:
        """Take in a normalised innovation squared; whether all is well.

        One outlier is never a doubt: it counts for at most half of what makes one.

        Args:
            nis: Chi-square with `degrees` degrees of freedom for each innovation if consistent.
            joint: Number of innovations in it, whose covariance is a joint one.
        """
        self._recent.append((nis, joint))
        degrees = self._degrees * sum(n for _, n in self._recent)
        begin, end = (chi_square_quantile(one, degrees) for one in (DISAGREE, AGREE))
        enough = len(self._recent) == self._recent.maxlen
        total = sum(min(one, begin / 2.0) for one, _ in self._recent)
        self.agrees = (not enough or total <= begin) if self.agrees else total <= end
        self.factor = 1.0 if self.agrees else max(1.0, total / degrees)
        return self.agrees
