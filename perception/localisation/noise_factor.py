"""How much larger or smaller the noise is than configured, learnt from the innovations of a run.

Another body slips otherwise, another camera sees otherwise. The factor moves while the innovations, in the mean, are
larger than their covariance explains, or smaller than a share of it: errors that last through many frames, such as those
of the neck's zero and of a tag's size, belong to the covariance and do not show from one frame to the next.

Source: ours; adaptive filters by innovations as in Mehra 1970.
"""

from __future__ import annotations

LEARN_SHARE = 0.04  # ours: weight of one innovation; some tens decide
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
        self._nis = 0.5 * (least_nis + 1.0)

    def learn(self, nis: float) -> None:
        """Take in one normalised squared innovation, per degree of freedom."""
        self._nis += LEARN_SHARE * (min(nis, LARGEST_NIS) - self._nis)
        unexplained = self._nis / min(max(self._nis, self._least), 1.0)
        self.value *= float(unexplained ** (LEARN_SHARE / 4.0))
        self.value = min(max(self.value, LEAST), MOST)
