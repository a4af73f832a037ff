"""Computing time per stage of the cycle."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from ...results.tables import Table


def stages(timing: Table) -> dict[str, Float[np.ndarray, "n"]]:
    """Milliseconds of each stage over the frames; 0 where a stage did not run."""
    names = [name for name in timing.columns if name not in ("stamp_s", "total")]
    return {name: np.nan_to_num(timing.numbers(name)) for name in names}


def timing_metrics(timing: Table) -> dict[str, dict[str, float]]:
    """Median, 95th percentile and maximum of each stage and of their sum ("total"), ms.

    The first frame of several is left out, because it includes loading and compilation.
    """
    columns = stages(timing)
    if not columns:
        return {}
    columns["total"] = np.sum(list(columns.values()), axis=0)
    skip = 1 if len(timing) > 1 else 0
    return {
        name: {
            "p50": float(np.percentile(values[skip:], 50)),
            "p95": float(np.percentile(values[skip:], 95)),
            "max": float(np.max(values[skip:])),
        }
        for name, values in columns.items()
    }
