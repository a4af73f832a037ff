"""Run-time checks of shape annotations during tests; the folder of real recordings; blocked packages.

With BLOCKED_PACKAGES="sim surefoot" these packages cannot be imported, which shows that the tests of the lower ones
do not need them (`make test-layers`).
"""

from __future__ import annotations

import importlib.abc
import os
import pkgutil
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path

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
            raise ImportError(f"{fullname} is blocked in this test run")
        return None


sys.meta_path.insert(0, Blocker())

# The same draws in every run; `--hypothesis-profile=search` draws new ones.
settings.register_profile("same", derandomize=True)
settings.register_profile("search", derandomize=False)
settings.load_profile("same")

# Kernels are left out: the check would wrap their functions before numba sees them.
_modules = [
    module.name
    for package in PACKAGES
    for module in pkgutil.walk_packages([str(ROOT / package)], f"{package}.")
    if not module.ispkg and not module.name.endswith("_kernels")
]
install_import_hook(_modules, "beartype.beartype")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of the real recordings; a test that needs it is skipped with a message where it is absent."""
    folder = Path(os.environ.get("SUREFOOT_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real recordings not found at {folder}; set SUREFOOT_DATA to their folder")
    return folder
