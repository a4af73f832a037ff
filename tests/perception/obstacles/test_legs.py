"""Legs of people in clusters: pairs, lone posts, two people side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from perception.obstacles.clustering import Cluster, Footprint
from perception.obstacles.legs import joined

LEG_M = 0.06


def post(x: float, y: float, radius_m: float = LEG_M, above: bool = True) -> Cluster:
    covariance = np.eye(2) * 0.01**2
    footprint = Footprint(2 * radius_m, radius_m, 0.0)
    return Cluster(np.array([x, y]), covariance, radius_m, 0.3, 500, footprint, goes_on_above=above)


def centres(found: list[Cluster]) -> list[tuple[float, float]]:
    return sorted((round(float(x), 6), round(float(y), 6)) for x, y in (c.centre for c in found))


def test_two_legs_are_one_person_whose_disc_covers_both():
    legs = [post(1.0, -0.1), post(1.04, 0.1)]
    (person,) = joined(legs)
    assert centres([person]) == [(1.02, 0.0)]
    for leg in legs:
        assert np.linalg.norm(leg.centre - person.centre) + LEG_M <= person.radius_m + 1e-9
    assert person.radius_m < 0.17


def test_two_people_side_by_side_stay_two():
    legs = [post(1.0, y) for y in (-0.32, -0.12, 0.12, 0.32)]
    assert centres(joined(legs)) == [(1.0, -0.22), (1.0, 0.22)]
    assert len(joined(legs[:1])) == 1


@pytest.mark.parametrize(
    "other", [post(1.0, 0.2, above=False), post(1.0, 0.25, radius_m=0.12), post(1.0, 0.4)]
)
def test_posts_whose_tops_are_seen_or_that_are_wide_or_far_apart_stay_apart(other):
    assert len(joined([post(1.0, 0.0), other])) == 2


def test_a_person_with_one_leg_partly_hidden_is_placed_less_exactly():
    whole = joined([post(1.0, -0.1), post(1.0, 0.1)])[0]
    hidden = joined([post(1.0, -0.1), replace(post(1.0, 0.1), whole=False)])[0]
    assert hidden.placed
    assert np.trace(hidden.covariance) > np.trace(whole.covariance)
    neither = [replace(post(1.0, y), whole=False) for y in (-0.1, 0.1)]
    assert not joined(neither)[0].placed


def test_a_third_post_beside_a_pair_stays_an_obstacle_of_its_own():
    found = joined([post(1.0, -0.1), post(1.0, 0.1), post(1.0, 0.35)])
    assert centres(found) == [(1.0, 0.0), (1.0, 0.35)]
