"""Many simulated walks: what the experiments that walk have in common."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ...config.schema import Config
from ...results.run_folder import RunFolder
from .experiment import Say
from .trials import each

Extra = Callable[[RunFolder, Config], dict[str, float]]


def walk(config: Config, extra: Extra | None = None) -> dict[str, Any]:
    """One live run in a folder that is thrown away.

    Args:
        config: Of the run.
        extra: More figures, from the run folder before it goes.

    Returns:
        Its metrics (see `surefoot.evaluation.metrics`), and those more.
    """
    from ...evaluation.evaluate import evaluate
    from ...run import simulate

    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "live"
        simulate.simulate(config, out, False, lambda text: None)
        folder = RunFolder.open(out)
        metrics = evaluate(folder)
        return metrics if extra is None else metrics | extra(folder, config)


def falls_of(found: Iterable[dict[str, Any]]) -> float:
    """Of so many runs; the kinematic body, whose metrics know no falls, has none."""
    return float(sum(one.get("falls", 0.0) for one in found))


def walk_all(
    configs: Iterable[Config], say: Say, extra: Extra | None = None
) -> list[dict[str, Any]]:
    """The metrics of every run, in order; each run in a process of its own."""
    todo = list(configs)
    found: list[dict[str, Any]] = []
    for metrics in each(walk, [(config, extra) for config in todo]):
        found.append(metrics)
        touched = sum(float(one.get("contacts", 0.0)) > 0.0 for one in found)
        say(f"{len(found)} of {len(todo)} walks, {touched} of them with a contact")
    return found
