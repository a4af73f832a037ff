"""Courses walked with images, compared with the same courses by geometric perception: is the shortcut valid?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...config.presets import on_body
from ..support.course_runner import CourseWalk, image_config, published, walk
from ..support.experiment import Say
from ..support.trials import run_all
from .course_trials import HEADER, figures, row


def walk_with_images(seed: int, body: str = "kinematic", mode: str = "ours") -> CourseWalk:
    """Walk the slow course of a seed with perception from images.

    Args:
        seed, body: As for courses by geometric perception.
        mode: "ours", or "seed" for seed 001's own walker.
    """
    config = on_body(image_config("course", seed), body)
    return walk(config if mode == "ours" else published(config, mode))


def image_figures(
    seeds: int, by_geometry: Sequence[CourseWalk], say: Say, body: str
) -> tuple[dict[str, float], list[str]]:
    """Figures of walks with images, of seed 001's walker too, and differences of ours from walks by geometric perception.

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
    theirs = run_all(walk_with_images, [(*one, "seed") for one in todo], say, "seed 001, images")
    seen |= {f"images_{name}": value for name, value in figures(theirs, "_seed").items()}
    table = [
        HEADER,
        row("slow, images", found),
        row("slow, geometric perception", by_geometry),
        row("slow, images, seed 001", theirs),
    ]
    return seen, table
