"""Checks before the installation: the version of Python and the shared libraries that Open3D needs.

Open3D's wheel needs four libraries that a minimal system lacks, and fails only when it is imported. This script checks
first, installs them where that is allowed, and otherwise prints the one command that does. It needs the standard
library only: `python surefoot/cli/bootstrap.py`.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys

LIBRARIES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
"""Shared library to its Debian package."""

OLDEST, NEWEST = (3, 11), (3, 13)
"""Versions of Python that are tested; gtsam 4.3 begins at 3.11."""

LAST_WITH_PYBULLET = (3, 11)
LOCKED = (3, 11)
"""The version of Python that requirements.lock is for."""


def missing_libraries() -> list[str]:
    """Shared libraries of Open3D that cannot be loaded."""
    absent = []
    for library in LIBRARIES:
        try:
            ctypes.CDLL(library)
        except OSError:
            absent.append(library)
    return absent


def missing_packages() -> list[str]:
    """Debian packages that are needed and not installed."""
    packages = [LIBRARIES[library] for library in missing_libraries()]
    if importlib.util.find_spec("ensurepip") is None:
        packages.append(f"python{sys.version_info[0]}.{sys.version_info[1]}-venv")
    return packages


def install_command(packages: list[str]) -> list[str]:
    """Command that installs Debian packages."""
    return ["apt-get", "install", "-y", "--no-install-recommends", *packages]


def privilege() -> list[str] | None:
    """Prefix of a command that installs: nothing as root, or sudo; None if neither is allowed."""
    if shutil.which("apt-get") is None:
        return None
    if os.geteuid() == 0:
        return []
    sudo = shutil.which("sudo")
    if sudo and subprocess.run([sudo, "-n", "true"], capture_output=True).returncode == 0:
        return [sudo, "-n"]
    return None


def main() -> int:
    """Check and install; 0 if the set-up can continue, else 2 after one line with what to do."""
    found = ".".join(map(str, sys.version_info[:3]))
    if not OLDEST <= sys.version_info[:2] <= NEWEST:
        print(
            f"surefoot: this is Python {found}, but 3.11 to 3.13 are supported; install 3.11 "
            "(apt-get install python3.11 python3.11-venv) and run: make PYTHON=python3.11 setup",
            file=sys.stderr,
        )
        return 2
    if sys.version_info[:2] > LAST_WITH_PYBULLET:
        print(
            f"surefoot: PyBullet has no wheel for Python {found}: recordings are processed and evaluated, but `surefoot "
            "simulate` needs Python 3.11 (make PYTHON=python3.11 setup)",
            file=sys.stderr,
        )
    packages = missing_packages()
    if not packages:
        return 0
    before = privilege()
    if before is not None:
        print(f"installing {' '.join(packages)}")
        quiet = {
            "stdout": subprocess.DEVNULL,
            "env": {**os.environ, "DEBIAN_FRONTEND": "noninteractive"},
        }
        subprocess.run([*before, "apt-get", "update"], **quiet)  # type: ignore[call-overload]
        subprocess.run([*before, *install_command(packages)], **quiet)  # type: ignore[call-overload]
        packages = missing_packages()
        if not packages:
            return 0
    print(
        f"surefoot: needs {', '.join(packages)}; run: sudo {' '.join(install_command(packages))}",
        file=sys.stderr,
    )
    return 2


if __name__ == "__main__":
    sys.exit(main())
