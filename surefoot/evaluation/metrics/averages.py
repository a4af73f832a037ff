"""Averages of a sample, NaN of an empty one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

Values = Sequence[Any] | np.ndarray


def mean(values: Values) -> float:
    """Arithmetic mean."""
    return float(np.mean(values)) if len(values) else math.nan


def median(values: Values) -> float:
    """Median."""
    return float(np.median(values)) if len(values) else math.nan


def rms(values: Values) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan


def percentile(values: Values, percent: float) -> float:
    """The value that so many per cent do not exceed."""
    return float(np.percentile(values, percent)) if len(values) else math.nan
