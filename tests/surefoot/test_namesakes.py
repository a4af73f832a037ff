"""A user's own folder `planning` or file `sim.py` that hides ours is named in one line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from surefoot import namesakes

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(params=["planning/__init__.py", "sim.py"])
def folder(request, tmp_path):
    """A working folder with a package or module of our name."""
    path = tmp_path / request.param
    path.parent.mkdir(exist_ok=True)
    path.touch()
    return tmp_path


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A new interpreter in that folder."""
    return subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )


def test_our_own_packages_are_accepted():
    assert namesakes.fault() == ""


def test_the_module_stops_with_one_line(folder):
    done = run(folder, "-m", "surefoot", "doctor")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert str(folder) in done.stderr
    assert "hides surefoot's package" in done.stderr


def test_a_program_gets_an_import_error_with_that_line(folder):
    (folder / "mine.py").write_text("import surefoot.config\n")
    done = run(folder, "mine.py")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("ImportError: surefoot: ")


def test_a_folder_without_an_init_file_does_not_hide_ours(tmp_path):
    (tmp_path / "planning").mkdir()
    assert run(tmp_path, "-c", "import surefoot.config").returncode == 0


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(namesakes, "PACKAGES", ("not_there",))
    assert "its package 'not_there' is missing" in namesakes.fault()


def test_the_command_stops_without_a_trace(monkeypatch, capsys):
    monkeypatch.setattr(namesakes, "PACKAGES", ("json",))
    monkeypatch.setattr(sys, "argv", ["/usr/bin/surefoot", "doctor"])
    with pytest.raises(SystemExit, match="2"):
        namesakes.refuse()
    assert "hides surefoot's package 'json'" in capsys.readouterr().err
