"""The compiler of the kernels: where compiled code is cached, and when it is compiled anew."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from perception.primitives import compiled

ROOT = Path(__file__).resolve().parents[3]
INNER = "from perception.primitives.compiled import njit\n@njit(cache=True)\ndef f(x):\n    return {} * x\n"
OUTER = (
    "from perception.primitives.compiled import njit\nfrom ._inner_kernels import f\nfrom .unit import UNIT\n"
    "@njit(cache=True)\ndef g(x):\n    return f(x) + UNIT\n"
)


@pytest.fixture(autouse=True)
def clear(monkeypatch):
    """No cached answers, no wishes of the environment."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    forget = compiled.cache_folder.cache_clear
    forget()
    yield
    forget()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package `robot` with two kernels, one of which uses the other and a constant."""
    root = tmp_path / "robot"
    root.mkdir()
    (root / "__init__.py").touch()
    (root / "unit.py").write_text("UNIT = 1\n")
    (root / "_inner_kernels.py").write_text(INNER.format(2))
    (root / "_outer_kernels.py").write_text(OUTER)
    module = type(sys)("robot")
    module.__file__ = str(root / "__init__.py")
    monkeypatch.setitem(sys.modules, "robot", module)
    return root


def block(folder: Path) -> None:
    """Make a folder impossible to create, even for root."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.touch()


def called(root: Path) -> int:
    """g(10) in a new interpreter."""
    code = "from robot._outer_kernels import g; print(g(10))"
    path = os.pathsep.join((str(root.parent), str(ROOT)))
    done = subprocess.run(
        [sys.executable, "-B", "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": ""},
    )
    return int(done.stdout)


def test_a_change_of_an_imported_kernel_or_constant_compiles_anew(package):
    assert called(package) == 21
    assert called(package) == 21
    assert len(list((package / "__pycache__").glob("kernels-*"))) == 1
    (package / "_inner_kernels.py").write_text(INNER.format(3))
    assert called(package) == 31
    (package / "unit.py").write_text("UNIT = 5\n")
    assert called(package) == 35


def test_the_cache_lies_beside_the_sources_if_they_are_writable(package):
    assert compiled.cache_folder("robot").parent == package / "__pycache__"


def test_the_cache_of_a_read_only_package_is_in_the_users_cache_folder(
    package, tmp_path, monkeypatch
):
    block(package / "__pycache__")
    monkeypatch.setattr(compiled.sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert compiled.cache_folder("robot").parent == tmp_path / "cache" / "surefoot"


def test_without_a_home_the_cache_is_a_private_temporary_folder(package, tmp_path, monkeypatch):
    block(package / "__pycache__")
    block(tmp_path / "home")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home" / "cache"))
    monkeypatch.setattr(compiled.tempfile, "tempdir", str(tmp_path))
    folder = compiled.cache_folder("robot").parent
    assert folder.parent == tmp_path
    assert folder.stat().st_mode & 0o077 == 0


def test_a_temporary_folder_that_others_can_write_is_not_used(package, tmp_path, monkeypatch):
    block(package / "__pycache__")
    monkeypatch.setenv("XDG_CACHE_HOME", str(package / "__pycache__"))
    monkeypatch.setattr(compiled.tempfile, "tempdir", str(tmp_path))
    (tmp_path / f"surefoot-{os.getuid()}").mkdir()
    (tmp_path / f"surefoot-{os.getuid()}").chmod(0o777)
    assert compiled.cache_folder("robot") is None


def test_the_environments_cache_folder_comes_first(package, tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "wanted"))
    assert compiled.cache_folder("robot").parent == tmp_path / "wanted"


def test_kernels_run_without_any_cache_and_leave_numbas_own_setting_alone(monkeypatch):
    numba.config.reload_config()  # takes over what earlier tests changed in the environment
    monkeypatch.setattr(numba.config, "CACHE_DIR", "as before")
    monkeypatch.setattr(compiled, "cache_folder", lambda package: None)

    @compiled.njit(cache=True, error_model="numpy")
    def inverse(x):
        return 1.0 / x

    assert inverse(0.0) == float("inf")
    assert numba.config.CACHE_DIR == "as before"
