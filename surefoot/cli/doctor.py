"""What this machine has, and what each missing piece costs."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from . import bootstrap

PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "opencv-python-headless",
    "gtsam",
    "filterpy",
    "pybullet",
    "mcap",
)
EGL_TRIAL = (
    "import importlib.util, pybullet as p\n"
    "c = p.connect(p.DIRECT)\n"
    "spec = importlib.util.find_spec('eglRenderer')\n"
    "plugin = p.loadPlugin(spec.origin, '_eglRendererPlugin') if spec else -1\n"
    "p.getCameraImage(8, 8, renderer=p.ER_BULLET_HARDWARE_OPENGL)\n"
    "print('renderer works' if plugin >= 0 else 'renderer fails')\n"
)


@dataclass(frozen=True)
class Finding:
    """One thing that was looked for.

    Args:
        name: Of the thing.
        found: Whether it is there.
        detail: Version or place, or what is wrong.
        cost: What is lost without it; "" where nothing is missing.
        mend: How to get it; "" where nothing is missing.
    """

    name: str
    found: bool
    detail: str
    cost: str = ""
    mend: str = ""


def examine() -> list[Finding]:
    """Look at everything that a run may use; nothing is changed."""
    checks: tuple[Callable[[], list[Finding]], ...] = (
        _python,
        _packages,
        _open3d,
        _renderer,
        _kernels,
        _extras,
        _data,
        _machine,
    )
    return [finding for check in checks for finding in check()]


def render(findings: list[Finding]) -> str:
    """The findings as lines for the terminal."""
    width = max(len(finding.name) for finding in findings)
    shown = []
    for finding in findings:
        mark = "ok     " if finding.found else "missing"
        shown.append(f"{mark}  {finding.name:<{width}}  {finding.detail}")
        if not finding.found:
            shown += [f"         {line}" for line in (finding.cost, finding.mend) if line]
    absent = sum(not finding.found for finding in findings)
    shown.append("everything is here" if absent == 0 else f"{absent} missing, as said above")
    return "\n".join(shown)


def _python() -> list[Finding]:
    right = sys.version_info[:2] == (3, 11)
    return [
        Finding(
            "Python",
            right,
            f"{sys.version.split()[0]} at {sys.executable}",
            "" if right else "PyBullet has no wheel for it: no simulation",
            "" if right else "make PYTHON=python3.11 setup",
        )
    ]


def _packages() -> list[Finding]:
    found = []
    for name in PACKAGES:
        try:
            found.append(Finding(name, True, importlib.metadata.version(name)))
        except importlib.metadata.PackageNotFoundError:
            found.append(
                Finding(name, False, "not installed", "nothing runs without it", "make setup")
            )
    if importlib.util.find_spec("pybullet"):
        code = "import pybullet; print(pybullet.isNumpyEnabled())"
        numpy = _output(code).endswith("1")
        found.append(
            Finding(
                "PyBullet with NumPy",
                numpy,
                "yes" if numpy else "no",
                "" if numpy else "camera images come a hundred times slower",
                "" if numpy else "install the wheel: make setup",
            )
        )
    return found


def _open3d() -> list[Finding]:
    absent = bootstrap.missing_libraries()
    found = []
    for name in ("open3d-cpu", "open3d"):
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        found.append(Finding("Open3D", True, f"{version} ({name})"))
        break
    else:
        found.append(
            Finding("Open3D", False, "not installed", "no clouds, no TOF camera", "make setup")
        )
    packages = [bootstrap.LIBRARIES[library] for library in absent]
    found.append(
        Finding(
            "Open3D's libraries",
            not absent,
            ", ".join(absent) or ", ".join(bootstrap.LIBRARIES),
            "Open3D cannot be loaded: no clouds, no simulated TOF camera" if absent else "",
            "sudo " + " ".join(bootstrap.install_command(packages)) if absent else "",
        )
    )
    return found


def _renderer() -> list[Finding]:
    works = "renderer works" in _output(EGL_TRIAL)
    return [
        Finding(
            "EGL renderer",
            works,
            "works (used for colour and stereo)" if works else "does not start",
            "" if works else "the software renderer takes three times as long, without shadows",
            "" if works else "sudo apt-get install libegl1 libgl1-mesa-dri",
        )
    ]


def _kernels() -> list[Finding]:
    root = Path(__file__).resolve().parents[2]
    caches = [
        p
        for package in ("perception", "mapping", "planning")
        for p in (root / package).rglob("*.nbi")
    ]
    return [
        Finding(
            "compiled kernels",
            bool(caches),
            f"{len(caches)} kept" if caches else "none kept yet",
            "" if caches else "the first run compiles for about half a minute",
            "" if caches else "python -m surefoot.cli.warmup",
        )
    ]


def _extras() -> list[Finding]:
    viser = importlib.util.find_spec("viser") is not None
    browser = next(
        (
            path
            for name in ("chromium", "chromium-browser", "google-chrome")
            if (path := shutil.which(name))
        ),
        None,
    )
    return [
        Finding(
            "viser (extra viz)",
            viser,
            importlib.metadata.version("viser") if viser else "not installed",
            ""
            if viser
            else "no live page (simulate --view, view --live); reports are not affected",
            "" if viser else ".venv/bin/pip install -c requirements.lock -e '.[viz]'",
        ),
        Finding(
            "Chromium",
            browser is not None,
            browser or "not found",
            "" if browser else "the test that renders the report page is left out",
            "" if browser else "sudo apt-get install chromium",
        ),
    ]


def _data() -> list[Finding]:
    folder = Path(os.environ.get("SUREFOOT_DATA", "../shared/data"))
    there = folder.is_dir()
    return [
        Finding(
            "real recordings",
            there,
            str(folder.resolve()) if there else f"not at {folder}",
            "" if there else "tests and experiments on real data are left out, aloud",
            "" if there else "set SUREFOOT_DATA to their folder",
        )
    ]


def _machine() -> list[Finding]:
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    enough = free > 1.0
    return [
        Finding("processor cores", True, str(os.cpu_count())),
        Finding(
            "free disk here",
            enough,
            f"{free:.1f} GB",
            "" if enough else "a recorded walk takes about 0.2 GB",
            "" if enough else "free some space or choose another --out",
        ),
    ]


def _output(code: str) -> str:
    """What a snippet prints, run apart because it may crash; "" if it does."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
        )
    except subprocess.TimeoutExpired:
        return ""
    return done.stdout.strip()
