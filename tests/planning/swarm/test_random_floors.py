"""The random floors on which searches are compared: what a cylinder hides, against points along each ray."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from planning.swarm import random_floors


def test_a_cylinder_hides_the_floor_whose_rays_pass_through_it():
    rng = np.random.default_rng(3)
    eye = np.array([0.05, 0.01, 0.383])
    floor = rng.uniform([0.2, -2.0], [4.0, 2.0], (300, 2))
    shares = np.linspace(0.0, 1.0, 4001)[:, None]
    for _ in range(10):
        middle, height = rng.uniform([0.45, -1.2], [3.0, 1.2]), rng.uniform(0.03, 0.3)
        gaps = random_floors._gap(floor, eye, middle, height)
        for place, gap in zip(floor, gaps, strict=True):
            on_ray = np.append(place, 0.0) + shares * (eye - np.append(place, 0.0))
            below = on_ray[on_ray[:, 2] <= height, :2]
            assert abs(cdist(below, middle[None]).min() - gap) < 2e-3
