"""`import surefoot`: light, complete, and typed by the same names."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import surefoot

HEAVY = ("numpy", "numba", "cv2", "open3d", "gtsam", "pybullet", "scipy", "matplotlib", "click")


def test_importing_the_package_loads_nothing_heavy_and_is_fast():
    code = (
        "import sys, time; t = time.perf_counter(); import surefoot; took = time.perf_counter() - t;"
        f"print(took, *[m for m in {HEAVY} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    took, *loaded = done.stdout.split()
    assert loaded == []
    assert float(took) < 0.1


@pytest.mark.parametrize("name", surefoot.__all__)
def test_every_public_name_loads_and_is_described(name):
    found = getattr(surefoot, name)
    assert name == "__version__" or found.__doc__
    assert name in dir(surefoot)


def test_the_names_for_type_checkers_are_the_public_names():
    tree = ast.parse(Path(surefoot.__file__).read_text())
    (checked,) = [node for node in tree.body if isinstance(node, ast.If)]
    imported = {
        alias.name
        for node in checked.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert imported | {"__version__"} == set(surefoot.__all__)
    assert set(surefoot.__all__) == set(surefoot._HOME) | {"__version__"}


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="find_flour"):
        getattr(surefoot, "find_" + "flour")
