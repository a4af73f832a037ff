"""The look at a bare machine: what is missing is named with the one command that brings it."""

from __future__ import annotations

import sys

import pytest

from surefoot.cli import bootstrap


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that lacks a library, and where nothing may be installed."""
    monkeypatch.setattr(sys, "version_info", (3, 11, 7, "final", 0))
    monkeypatch.setattr(bootstrap, "LIBRARIES", {"libnot-there.so.9": "libnot-there9"})
    monkeypatch.setattr(bootstrap, "privilege", lambda: None)


def test_a_library_that_cannot_be_loaded_is_missing(bare):
    assert bootstrap.missing_libraries() == ["libnot-there.so.9"]
    assert "libnot-there9" in bootstrap.missing_packages()


def test_without_the_right_to_install_one_line_says_what_to_run(bare, capsys):
    assert bootstrap.main() == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert "sudo apt-get install -y --no-install-recommends libnot-there9" in said[0]


@pytest.mark.parametrize("version", [(3, 10, 4), (3, 14, 0)])
def test_an_unsupported_python_is_refused_with_the_command_that_helps(monkeypatch, capsys, version):
    monkeypatch.setattr(sys, "version_info", (*version, "final", 0))
    assert bootstrap.main() == 2
    said = capsys.readouterr().err
    assert ".".join(map(str, version)) in said
    assert "make PYTHON=python3.11 setup" in said


def test_a_python_without_pybullet_is_accepted_with_a_warning(monkeypatch, capsys):
    monkeypatch.setattr(sys, "version_info", (3, 13, 1, "final", 0))
    monkeypatch.setattr(bootstrap, "LIBRARIES", {"libc.so.6": "libc6"})
    assert bootstrap.main() == 0
    assert "`surefoot simulate` needs Python 3.11" in capsys.readouterr().err


def test_where_nothing_is_missing_nothing_is_done(monkeypatch, capsys):
    monkeypatch.setattr(sys, "version_info", (3, 11, 7, "final", 0))
    monkeypatch.setattr(bootstrap, "LIBRARIES", {"libc.so.6": "libc6"})
    assert bootstrap.main() == 0
    assert capsys.readouterr().err == ""
