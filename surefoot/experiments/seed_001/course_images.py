"""The courses walked from pictures, beside the same courses by geometry: does the shortcut tell the truth?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...config.presets import on_body
from ..support.course_runner import Walk, pictures_config, walk
from ..support.experiment import Say
from ..support.trials import each
from .course_trials import HEADER, figures, row


def walk_from_pictures(seed: int, body: str = "kinematic") -> Walk:
    """The slow course of a seed, all from pictures."""
    return walk(on_body(pictures_config("course", seed), body))


def image_figures(
    seeds: int, by_geometry: Sequence[Walk], say: Say, body: str
) -> tuple[dict[str, float], list[str]]:
    """Figures of walks from pictures, and how far those by geometry are from them.

    Args:
        seeds: How many, from 0.
        by_geometry: The same seeds by the geometric sensor.
        say: Progress.
        body: Who walks.
    """
    found: list[Walk] = []
    for one in each(walk_from_pictures, [(seed, body) for seed in range(seeds)]):
        found.append(one)
        say(f"{len(found)} of {seeds} courses from pictures")
    seen = {f"images_{name}": value for name, value in figures(found).items()}
    seen["images_time_ratio"] = float(
        np.mean([one.time_s for one in found]) / np.mean([one.time_s for one in by_geometry])
    )
    seen["images_free_difference"] = float(
        np.mean([not one.contacts for one in found])
        - np.mean([not one.contacts for one in by_geometry])
    )
    table = [HEADER, row("slow, from pictures", found), row("the same by geometry", by_geometry)]
    return seen, table
