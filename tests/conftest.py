"""Shape annotations become run-time checks during tests; the place of the real recordings."""

from __future__ import annotations

import os
import pkgutil
from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("perception", "mapping", "planning", "sim", "surefoot")

# The same draws each time, as everything random here; `--hypothesis-profile=search` looks for new ones.
settings.register_profile("same", derandomize=True)
settings.register_profile("search", derandomize=False)
settings.load_profile("same")

# Modules one by one: the check would wrap compiled functions before numba sees them.
_modules = [
    module.name
    for package in PACKAGES
    for module in pkgutil.walk_packages([str(ROOT / package)], f"{package}.")
    if not module.ispkg and not module.name.endswith("_kernels")
]
install_import_hook(_modules, "beartype.beartype")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of the real recordings; a test that needs it skips aloud where it is absent."""
    folder = Path(os.environ.get("SUREFOOT_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real recordings not found at {folder}; set SUREFOOT_DATA to their folder")
    return folder
