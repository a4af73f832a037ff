"""How much larger or smaller the noise is than configured, learnt from the innovations of a run.

Another body slips otherwise, another camera sees otherwise. The factor follows the mean of the squared innovations, by
the first few tens quickly. It stays while they are, in the mean, no larger than their covariance explains and no smaller
than a share of it: errors that last through many frames, such as those of the neck's zero and of a tag's size, belong to
the covariance and do not show from one frame to the next.

Source: ours; adaptive filters by innovations as in Mehra 1970.
"""

from __future__ import annotations

import math

PRIOR, MEMORY = 15, 60
"""Ours: number of innovations as which the configured noise counts, and over which the mean is formed."""
LARGEST_NIS = 10.0  # ours: an outlier says no more than this
LEAST, MOST = 0.5, 3.0  # ours: bounds of the factor; too large a noise is safer than too small


class NoiseFactor:
    """Factor of the standard deviations of one kind of noise."""

    def __init__(self, least_nis: float) -> None:
        """Begin at 1.

        Args:
            least_nis: Smallest mean of the normalised squared innovations, per degree of freedom, that is no reason to
                reduce the noise; 1 if all errors are new in every frame.
        """
        self.value = 1.0
        self._least = least_nis
        self._squared = math.sqrt(
            least_nis
        )  # mean innovation squared, in variances of the configured noise
        self._count = PRIOR

    def learn(self, nis: float) -> None:
        """Take in one normalised squared innovation, per degree of freedom."""
        self._count = min(self._count + 1, MEMORY)
        self._squared += (min(nis, LARGEST_NIS) * self.value**2 - self._squared) / self._count
        least, most = math.sqrt(self._squared), math.sqrt(self._squared / self._least)
        self.value = min(max(min(max(self.value, least), most), LEAST), MOST)
