"""Without PyBullet a simulation stops with one clear message, before it begins."""

from __future__ import annotations

import subprocess
import sys

import pytest

from perception.primitives.errors import SurefootError
from sim import bullet
from sim.robot_config import RobotConfig

needs_bullet = pytest.mark.skipif(
    bullet.require.__name__ != "require", reason="PyBullet is not installed, so that tests skip"
)


@pytest.fixture
def absent(monkeypatch):
    """PyBullet cannot be imported."""
    monkeypatch.setitem(sys.modules, "pybullet", None)


@needs_bullet
@pytest.mark.parametrize(
    ("version", "advice"),
    [
        ((3, 11, 7), "not installed; run: pip install pybullet"),
        ((3, 13, 0), "has no wheel for Python 3.13; install surefoot under Python 3.11"),
    ],
)
def test_the_message_says_what_to_do_on_this_python(absent, monkeypatch, version, advice):
    monkeypatch.setattr(bullet.sys, "version_info", version)
    with pytest.raises(SurefootError, match=advice):
        bullet.library()


@needs_bullet
@pytest.mark.parametrize(
    "robot",
    [
        RobotConfig(),
        RobotConfig(stereo=False, colour=False),
        RobotConfig(body="dynamic", tof=False, stereo=False, colour=False),
    ],
)
def test_images_ranges_and_the_dynamic_body_need_pybullet(absent, robot):
    assert robot.needs_pybullet
    with pytest.raises(SurefootError, match="the simulation needs PyBullet"):
        bullet.require()


@pytest.mark.parametrize("tof", [{"tof": False}, {"tof_source": "rays"}])
def test_a_kinematic_robot_whose_ranges_are_cast_does_not_need_pybullet(tof):
    assert not RobotConfig(stereo=False, colour=False, **tof).needs_pybullet


def test_simulate_without_pybullet_writes_nothing(tmp_path):
    code = (
        "import sys; sys.modules['pybullet'] = None; sys.argv[0] = 'surefoot'\n"
        "from surefoot.cli.main import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "simulate", "home", "--out", str(tmp_path / "run")],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("surefoot: the simulation needs PyBullet")
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "run").exists()
