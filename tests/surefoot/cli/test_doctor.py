"""The doctor names every package that surefoot can use, and gives advice that fits the installation."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest

from surefoot.cli import bootstrap, doctor

PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]


def distributions(requirements):
    """Names of the requirements, with the extras of Dask as distributions of their own."""
    found = set()
    for requirement in requirements:
        name, extra = re.match(r"([\w.-]+)(?:\[(\w+)\])?", requirement).groups()
        found |= {name} | ({extra} if extra else set())
    return found


@pytest.fixture
def nothing_installed(monkeypatch):
    """An environment where no distribution is found, on Python 3.11."""
    monkeypatch.setattr(doctor, "_version", lambda distribution: "")
    monkeypatch.setattr(sys, "version_info", (3, 11, 7, "final", 0))


def test_every_requirement_is_named():
    assert distributions(PROJECT["dependencies"]) - {"open3d-cpu"} == set(doctor.REQUIRED)


@pytest.mark.parametrize("extra", PROJECT["optional-dependencies"])
def test_every_package_of_an_extra_is_named(extra):
    wanted = distributions(PROJECT["optional-dependencies"][extra])
    named = {name for names in doctor.EXTRAS.values() for name in names}
    assert wanted <= named
    assert set(doctor.EXTRAS[extra]) <= wanted
    assert extra in doctor.COSTS


def test_the_supported_pythons_are_those_of_the_project():
    classified = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if "Python :: 3." in c]
    assert classified == [
        f"3.{minor}" for minor in range(bootstrap.OLDEST[1], bootstrap.NEWEST[1] + 1)
    ]


def test_in_a_checkout_the_advice_is_to_set_it_up(nothing_installed):
    found = {finding.name: finding for finding in doctor._required() + doctor._extras()}
    assert found["numpy"].mend == "make setup"
    assert found["extra batch"].detail == "not installed: dask, distributed"
    assert found["extra batch"].mend.endswith("[batch]'")
    assert "requirements.lock -e " in found["extra batch"].mend


def test_with_a_wheel_the_advice_needs_no_checkout(nothing_installed, monkeypatch):
    monkeypatch.setattr(doctor, "CHECKOUT", False)
    findings = doctor._python() + doctor._required() + doctor._extras() + doctor._browser()
    advice = [finding.mend for finding in findings]
    assert not any(word in line for line in advice for word in ("make ", "lock", " -e "))
    assert f"{sys.executable} -m pip install 'surefoot[rerun]'" in advice


def test_pybullet_is_optional_where_it_has_no_wheel(nothing_installed, monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 13, 0, "final", 0))
    pybullet = next(finding for finding in doctor._required() if finding.name == "pybullet")
    assert pybullet.optional
    assert "Python 3.11" in pybullet.mend


def test_the_last_line_counts_what_is_missing():
    findings = [
        doctor.Finding("here", True, "1.0"),
        doctor.Finding("needed", False, "not installed", "nothing works", "install it"),
        doctor.Finding("useful", False, "not installed", "less works", "buy it", optional=True),
    ]
    lines = doctor.render(findings).splitlines()
    assert [line.split()[0] for line in lines if line[0] != " "] == ["ok", "missing", "absent", "1"]
    assert lines[-1] == "1 required part missing, 1 optional absent"
