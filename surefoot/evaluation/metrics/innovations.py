"""Innovations of a filter: consistency of their size, and whiteness.

The innovations of a consistent filter are white. The autocorrelation is computed over successive measurements of
the same landmark or track; a lasting correlation means that the model lacks a constant or slow error.

Source: Bar-Shalom, Li, Kirubarajan 2001, section 5.4.2 (tests of normalised innovations and whiteness).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...results.tables import Table
from .consistency import consistency_metrics

LAGS = 10
WHITENED = ("whitened_0", "whitened_1")


@dataclass(frozen=True)
class Innovations:
    """Innovations of one source, in order of time.

    Args:
        source: "landmark" or "track".
        series: Whitened innovations of each landmark or track, (n, 2) each.
        whitened: All of them.
    """

    source: str
    series: tuple[Float[np.ndarray, "_ 2"], ...]
    whitened: Float[np.ndarray, "n 2"]


def innovations(table: Table) -> list[Innovations]:
    """Read innovations.csv; sources in order of appearance."""
    sources, identities = table.words("source"), table.words("identity")
    whitened = table.matrix(*WHITENED)
    found = []
    for source in dict.fromkeys(sources):
        mine = np.array([word == source for word in sources])
        named = [name for name, chosen in zip(identities, mine, strict=True) if chosen]
        rows = whitened[mine]
        series = tuple(
            rows[np.array([name == identity for name in named])]
            for identity in dict.fromkeys(named)
            if identity  # measurements without an identity have no successor
        )
        found.append(Innovations(source, series, rows))
    return found


def autocorrelation(
    series: tuple[Float[np.ndarray, "_ 2"], ...],
) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Autocorrelation of the innovations over all series.

    Returns:
        For lags 1 to `LAGS`, as far as there are 20 pairs: the correlation, and the bound that the magnitude
        for white innovations stays below with probability 95 %.
    """
    power = sum(float(np.sum(one**2)) for one in series)
    numbers = sum(one.size for one in series)
    values, bounds = [], []
    for lag in range(1, LAGS + 1):
        pairs = sum(one[lag:].size for one in series)
        if pairs < 20 or power == 0.0:
            break
        product = sum(float(np.sum(one[lag:] * one[:-lag])) for one in series)
        values.append(product / pairs / (power / numbers))
        bounds.append(1.96 / math.sqrt(pairs))
    return np.array(values), np.array(bounds)


def innovation_metrics(table: Table) -> dict[str, float | bool]:
    """Figures of each source.

    Returns:
        Figures of `consistency_metrics` with "nis"; with enough pairs also <source>_whiteness_max (largest
        magnitude of the correlation divided by its bound) and <source>_lag1 (correlation at lag 1).
    """
    figures: dict[str, float | bool] = {}
    for one in innovations(table):
        figures |= consistency_metrics(one.whitened, one.source, "nis")
        values, bounds = autocorrelation(one.series)
        if len(values):
            figures[f"{one.source}_lag1"] = float(values[0])
            figures[f"{one.source}_whiteness_max"] = float(np.max(np.abs(values) / bounds))
    return figures
