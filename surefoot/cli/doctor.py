"""Report of this machine: what is installed, what each missing part costs, and the command that installs it."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .. import cores
from . import bootstrap

ROOT = Path(__file__).resolve().parents[2]
CHECKOUT = (ROOT / "pyproject.toml").is_file()
"""Whether this is a checkout of the repository; else an installed wheel."""

REQUIRED = {
    "numpy": "nothing runs without it",
    "scipy": "nothing runs without it",
    "numba": "nothing runs without it",
    "opencv-python-headless": "nothing runs without it",
    "jaxtyping": "nothing runs without it",
    "click": "there is no command line without it",
    "tomli-w": "no run can be written",
    "mcap": "no recording is read or written",
    "mcap-protobuf-support": "no recording is read or written",
    "foxglove-schemas-protobuf": "no recording is read or written",
    "protobuf": "no recording is read or written",
    "rosbags": "no ROS bag is read",
    "open3d": "no point clouds, no simulated time-of-flight camera",
    "gtsam": "no smoothing, no panorama, no map of a recording without poses",
    "filterpy": "the filter engine filterpy is missing; ours is the default",
    "matplotlib": "no figures and no report",
    "duckdb": "no run can be written, nor asked in SQL",
    "pybullet": "no simulation of camera images, and no dynamic body without MuJoCo",
}
"""Distribution that surefoot requires, to what does not work without it."""

EXTRAS = {
    "physics": ("mujoco",),
    "rerun": ("rerun-sdk",),
    "robots": ("example-robot-data",),
    "batch": ("dask", "distributed"),
    "cloud": ("fsspec", "s3fs"),
    "docs": ("ipykernel", "myst-nb", "pydata-sphinx-theme", "sphinx"),
    "bench": (
        "connected-components-3d",
        "dijkstra3d",
        "kiss-icp",
        "octomap-python",
        "pyastar2d",
        "pyransac3d",
        "pyswarms",
        "scikit-fuzzy",
        "scikit-image",
        "small_gicp",
    ),
    "dev": (
        "beartype",
        "hypothesis",
        "import-linter",
        "mypy",
        "networkx",
        "pytest",
        "pytest-xdist",
        "ruff",
        "scipy-stubs",
    ),
}
"""Extra of surefoot to the distributions that it installs."""

COSTS = {
    "physics": "no dynamic body in MuJoCo (robot.dynamic.engine), only in PyBullet",
    "rerun": "no file of rerun (export --rerun)",
    "robots": "no walk as G1, Talos or iCub (simulate --robot)",
    "batch": "no cluster for `surefoot batch` (--scheduler)",
    "cloud": "no recordings at addresses such as s3://...",
    "docs": "`make docs` does not run",
    "bench": "`surefoot bench` runs without these comparisons",
    "dev": "the tests or `make lint` do not run",
}

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
    """Result of one check.

    Args:
        name: Name of the part.
        found: Whether it is there and works.
        detail: Version or path, or the fault.
        cost: What does not work without it; "" if found.
        mend: Command or action that provides it; "" if found.
        optional: Whether surefoot's main functions work without it.
    """

    name: str
    found: bool
    detail: str
    cost: str = ""
    mend: str = ""
    optional: bool = False


def examine() -> list[Finding]:
    """Check everything that a run may use; nothing is changed."""
    checks: tuple[Callable[[], list[Finding]], ...] = (
        _python,
        _required,
        _pybullet,
        _open3d_libraries,
        _kernels,
        _extras,
        _browser,
        _data,
        _machine,
    )
    return [finding for check in checks for finding in check()]


def render(findings: list[Finding]) -> str:
    """The findings as lines for the terminal."""
    width = max(len(finding.name) for finding in findings)
    lines = []
    for finding in findings:
        mark = "ok" if finding.found else "absent" if finding.optional else "missing"
        lines.append(f"{mark:<7}  {finding.name:<{width}}  {finding.detail}")
        if not finding.found:
            lines += [f"         {line}" for line in (finding.cost, finding.mend) if line]
    missing = sum(not finding.found and not finding.optional for finding in findings)
    absent = sum(not finding.found and finding.optional for finding in findings)
    lines.append(
        f"{missing or 'no'} required part{'s' * (missing != 1)} missing, {absent or 'no'} optional absent"
    )
    return "\n".join(lines)


def _finding(
    name: str, found: bool, detail: str, cost: str, mend: str, optional: bool = False
) -> Finding:
    """A finding; cost and remedy are dropped if the part is there."""
    return Finding(name, found, detail, *(("", "") if found else (cost, mend)), optional)


def _python() -> list[Finding]:
    right = (3, 11) <= sys.version_info[:2] <= bootstrap.NEWEST
    return [
        _finding(
            "Python",
            right,
            f"{sys.version.split()[0]} at {sys.executable}",
            "tested are 3.11 to {}.{}".format(*bootstrap.NEWEST),
            "make PYTHON=python3.11 setup" if CHECKOUT else "install surefoot under Python 3.11",
        )
    ]


def _version(distribution: str) -> str:
    """Version of an installed distribution; "" if it is not installed."""
    names = (distribution, "open3d-cpu") if distribution == "open3d" else (distribution,)
    for name in names:
        try:
            return importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return ""


def _pip(words: str) -> str:
    """Command that installs something into this environment."""
    locked = CHECKOUT and sys.version_info[:2] == bootstrap.LOCKED
    return f"{sys.executable} -m pip install {f'-c {ROOT}/requirements.lock ' * locked}{words}"


def _required() -> list[Finding]:
    wheel = sys.version_info[:2] <= bootstrap.LAST_WITH_PYBULLET
    findings = []
    for name, cost in REQUIRED.items():
        version = _version(name)
        mend = "make setup" if CHECKOUT else _pip(name)
        if name == "pybullet" and not wheel:
            mend = "it has no wheel for this Python; install surefoot under Python 3.11 to simulate"
        optional = name == "filterpy" or (name == "pybullet" and not wheel)
        findings.append(
            _finding(name, bool(version), version or "not installed", cost, mend, optional)
        )
    return findings


def _pybullet() -> list[Finding]:
    if importlib.util.find_spec("pybullet") is None:
        return []
    arrays = _output("import pybullet; print(pybullet.isNumpyEnabled())").endswith("1")
    renderer = "renderer works" in _output(EGL_TRIAL)
    return [
        _finding(
            "PyBullet with NumPy",
            arrays,
            "yes" if arrays else "no",
            "camera images take a hundred times as long",
            f"install its wheel: {_pip('--force-reinstall --only-binary :all: pybullet')}",
        ),
        _finding(
            "EGL renderer",
            renderer,
            "works (for colour and stereo)" if renderer else "does not start",
            "the software renderer takes three times as long and draws no shadows",
            "sudo apt-get install libegl1 libgl1-mesa-dri",
            optional=True,
        ),
    ]


def _open3d_libraries() -> list[Finding]:
    absent = bootstrap.missing_libraries()
    packages = [bootstrap.LIBRARIES[library] for library in absent]
    return [
        _finding(
            "Open3D's libraries",
            not absent,
            ", ".join(absent or bootstrap.LIBRARIES),
            "Open3D cannot be loaded: no point clouds, no simulated time-of-flight camera",
            "sudo " + " ".join(bootstrap.install_command(packages)),
        )
    ]


def _kernels() -> list[Finding]:
    if importlib.util.find_spec("numba") is None:
        return []
    from perception.primitives import compiled  # imports Numba

    folders = []
    for package in ("perception", "mapping", "planning", "sim", "surefoot"):
        importlib.import_module(package)
        folders.append(compiled.cache_folder(package))
    number = sum(len(list(folder.glob("**/*.nbi"))) for folder in folders if folder is not None)
    first = folders[0]
    if first is None:
        return [
            Finding(
                "compiled kernels",
                False,
                "no folder is writable",
                "every start compiles for about a minute",
                "set NUMBA_CACHE_DIR to a folder that you can write",
            )
        ]
    return [
        _finding(
            "compiled kernels",
            number > 0,
            f"{number} in {first}" + " and the like" * (number > 0),
            "the first run compiles for about a minute",
            f"{sys.executable} -m surefoot.cli.warmup",
            optional=True,
        )
    ]


def _extras() -> list[Finding]:
    findings = []
    for extra, names in EXTRAS.items():
        if extra in ("dev", "docs") and not CHECKOUT:
            continue
        versions = {name: _version(name) for name in names}
        absent = [name for name, version in versions.items() if not version]
        present = [f"{name} {version}" for name, version in versions.items() if version]
        target = f"-e '{ROOT}[{extra}]'" if CHECKOUT else f"'surefoot[{extra}]'"
        detail = [", ".join(present)] * bool(present)
        detail += ["not installed: " + ", ".join(absent)] * bool(absent)
        findings.append(
            _finding(
                f"extra {extra}", not absent, "; ".join(detail), COSTS[extra], _pip(target), True
            )
        )
    return findings


def _browser() -> list[Finding]:
    names = ("chromium", "chromium-browser", "google-chrome")
    browser = next((path for name in names if (path := shutil.which(name))), None)
    return [
        _finding(
            "Chromium",
            browser is not None,
            browser or "not found",
            "the test that renders the report page is skipped",
            "sudo apt-get install chromium",
            optional=True,
        )
    ] * CHECKOUT


def _data() -> list[Finding]:
    folder = Path(os.environ.get("SUREFOOT_DATA", "../shared/data"))
    there = folder.is_dir()
    return [
        _finding(
            "real recordings",
            there,
            str(folder.resolve()) if there else f"not at {folder}",
            "tests and experiments on real recordings are skipped",
            "set SUREFOOT_DATA to their folder",
            optional=True,
        )
    ]


def _machine() -> list[Finding]:
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    return [
        Finding("processor cores", True, str(cores.available())),
        _finding(
            "free disk space here",
            free > 1.0,
            f"{free:.1f} GB",
            "a recorded walk takes about 0.2 GB",
            "free some space or choose another --out",
        ),
    ]


def _output(code: str) -> str:
    """Output of a snippet, run in another process because it may crash; "" if it does."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
        )
    except subprocess.TimeoutExpired:
        return ""
    return done.stdout.strip()
