"""The humanoid of boxes that the tests ship, and the models of other makers where they are installed."""

from pathlib import Path

import pytest

from sim.robots import catalogue, installed
from sim.robots.jointed import jointed

LITTLE = Path(__file__).resolve().parents[2] / "little_robot" / "little.toml"


@pytest.fixture(scope="session")
def little():
    """The humanoid of boxes."""
    return jointed(catalogue.read(LITTLE))


@pytest.fixture(scope="session", params=["g1", "talos", "icub"])
def maker(request):
    """A model of another maker; skips where its package is not installed."""
    described = catalogue.load(request.param)
    if installed.folder(described.package) is None:
        pytest.skip(f"{described.package} is not installed: {installed.EXTRA}")
    return jointed(described)
