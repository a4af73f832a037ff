"""Run-time checks of shape annotations; the folder of real recordings; blocked packages; PyBullet.

With CHECK_SHAPES=1 every call checks the shapes of its arrays, which doubles the time of the tests. With
BLOCKED_PACKAGES="sim surefoot" these packages cannot be imported, which shows that the tests of the lower ones do not
need them. `make test-layers` does both, `make test-shapes` checks the shapes in all other tests.
"""

from __future__ import annotations

import gc
import importlib.abc
import importlib.util
import os
import pkgutil
import signal
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from importlib.machinery import ModuleSpec
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

ROOT = Path(__file__).resolve().parents[1]
BLOCKED = os.environ.get("BLOCKED_PACKAGES", "").split()
PACKAGES = [
    package
    for package in ("perception", "mapping", "planning", "sim", "surefoot")
    if package not in BLOCKED
]


class Blocker(importlib.abc.MetaPathFinder):
    """Refuses to import the blocked packages."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: object = None
    ) -> ModuleSpec | None:
        """Nothing for packages that are not blocked."""
        if fullname.partition(".")[0] in BLOCKED:
            raise ModuleNotFoundError(f"{fullname} is blocked in this test run", name=fullname)
        return None


sys.meta_path.insert(0, Blocker())

# The same draws in every run; `--hypothesis-profile=search` draws new ones. No test is timed.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("search", derandomize=False, deadline=None)
settings.load_profile("same")

if os.environ.get("CHECK_SHAPES"):
    # Kernels are left out: the check would wrap their functions before numba sees them.
    _modules = [
        module.name
        for package in PACKAGES
        for module in pkgutil.walk_packages([str(ROOT / package)], f"{package}.")
        if not module.ispkg and not module.name.endswith("_kernels")
    ]
    install_import_hook(_modules, "beartype.beartype")


if "sim" not in BLOCKED and importlib.util.find_spec("pybullet") is None:
    # Skip exactly the tests that reach PyBullet: pytest.skip passes every `except Exception` in between.
    from perception.primitives.errors import SurefootError
    from sim import bullet

    _require = bullet.require

    def _require_or_skip() -> None:
        try:
            _require()
        except SurefootError as error:
            pytest.skip(str(error))

    bullet.require = _require_or_skip


if "sim" not in BLOCKED:
    from sim.rendering import pictures

    # Painting a scene takes seconds, and many tests of a file walk in the same one.
    pictures.paint_scene = lru_cache(maxsize=2)(pictures.paint_scene)


def pytest_collection_finish() -> None:
    """Modules and tests live to the end: let no search for garbage pass through them."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000)


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Python's usual answer to Ctrl-C, also where the test run was started with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of the real recordings; a test that needs it is skipped with a message where it is absent."""
    folder = Path(os.environ.get("SUREFOOT_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real recordings not found at {folder}; set SUREFOOT_DATA to their folder")
    return folder


@pytest.fixture
def undistort() -> Callable[..., np.ndarray]:
    """cv2.undistortPoints(points, K, distortion, R, P, criteria) of OpenCV 5, in OpenCV 4 too."""

    def iterated(points, K, distortion, R, P, criteria):
        if hasattr(cv2, "undistortPointsIter"):  # OpenCV 4
            return cv2.undistortPointsIter(points, K, distortion, R, P, criteria)
        return cv2.undistortPoints(points, K, distortion, None, R, P, criteria)

    return iterated
