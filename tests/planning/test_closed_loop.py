"""Route, field, footsteps, guard and gaze together, over a few rooms with blind movers."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def closed_loop():
    place = Path(__file__).with_name("closed_loop.py")
    spec = importlib.util.spec_from_file_location("closed_loop", place)
    module = importlib.util.module_from_spec(spec)
    sys.modules["closed_loop"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("seed", range(1000, 1006))
def test_it_crosses_a_room_with_three_movers_and_touches_nothing(closed_loop, seed):
    result = closed_loop.walk(seed, closed_loop.Settings())
    assert result.contacts == []
    assert result.arrived


def test_without_the_guard_the_same_rooms_see_contacts(closed_loop):
    """The rooms are no easy ones: if they were, the test above would prove nothing."""
    bare = closed_loop.Settings(use_guard=False)
    assert any(closed_loop.walk(seed, bare).contacts for seed in range(1000, 1010))


def test_the_same_seed_walks_the_same_way(closed_loop):
    runs = [closed_loop.walk(1001, closed_loop.Settings()) for _ in range(2)]
    assert runs[0].trace == runs[1].trace
