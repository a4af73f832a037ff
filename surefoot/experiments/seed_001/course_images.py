"""Courses walked with images, compared with the same courses by geometric perception: is the shortcut valid?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...config.presets import on_body
from ..support.course_runner import CourseWalk, image_config, walk
from ..support.experiment import Say
from ..support.trials import run_all
from .course_trials import HEADER, figures, row


def walk_with_images(seed: int, body: str = "kinematic") -> CourseWalk:
    """Walk the slow course of a seed with perception from images."""
    return walk(on_body(image_config("course", seed), body))


def image_figures(
    seeds: int, by_geometry: Sequence[CourseWalk], say: Say, body: str
) -> tuple[dict[str, float], list[str]]:
    """Figures of walks with images, and their differences from walks by geometric perception.

    Args:
        seeds: Number of seeds, from 0.
        by_geometry: Walks with the same seeds by geometric perception.
        say: Progress callback.
        body: "kinematic" or "dynamic".
    """
    todo = [(seed, body) for seed in range(seeds)]
    found = run_all(walk_with_images, todo, say, "courses with images")
    seen = {f"images_{name}": value for name, value in figures(found).items()}
    seen["images_time_ratio"] = float(
        np.mean([one.time_s for one in found]) / np.mean([one.time_s for one in by_geometry])
    )
    seen["images_free_difference"] = float(
        np.mean([not one.contacts for one in found])
        - np.mean([not one.contacts for one in by_geometry])
    )
    table = [HEADER, row("slow, images", found), row("slow, geometric perception", by_geometry)]
    return seen, table
