"""The humanoid of boxes that the tests ship, and the models of other makers where they are installed."""

from pathlib import Path

import pytest

from sim.robots import catalogue, installed
from sim.robots.jointed import jointed

LITTLE = Path(__file__).resolve().parents[1] / "little_robot" / "little.toml"


@pytest.fixture(scope="session")
def little():
    """The humanoid of boxes."""
    return jointed(catalogue.read(LITTLE))


@pytest.fixture(scope="session", params=["g1", "talos", "icub"])
def described(request):
    """The description of a maker's robot; skips where its package is not installed."""
    found = catalogue.load(request.param)
    if installed.folder(found.package) is None:
        pytest.skip(f"{found.package} is not installed: {installed.EXTRA}")
    return found


@pytest.fixture(scope="session")
def maker(described):
    """A model of another maker."""
    return jointed(described)
