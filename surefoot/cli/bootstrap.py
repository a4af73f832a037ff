"""Before anything is installed: is this the right Python, and are the shared libraries there?

Open3D's wheel needs four libraries that a bare machine lacks, and says so only when it is imported. This
looks first, installs them where that is allowed, and otherwise prints the one command that does. It runs
with nothing but the standard library, as `python surefoot/bootstrap.py`.
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
"""Shared library to the Debian package that brings it."""


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
    """Debian packages that are needed and absent."""
    packages = [LIBRARIES[library] for library in missing_libraries()]
    if importlib.util.find_spec("ensurepip") is None:
        packages.append(f"python{sys.version_info[0]}.{sys.version_info[1]}-venv")
    return packages


def install_command(packages: list[str]) -> list[str]:
    """What installs them."""
    return ["apt-get", "install", "-y", "--no-install-recommends", *packages]


def privilege() -> list[str] | None:
    """What to put before a command so that it may install: nothing, sudo, or None if neither works."""
    if shutil.which("apt-get") is None:
        return None
    if os.geteuid() == 0:
        return []
    sudo = shutil.which("sudo")
    if sudo and subprocess.run([sudo, "-n", "true"], capture_output=True).returncode == 0:
        return [sudo, "-n"]
    return None


def main() -> int:
    """Check, install, and say what is left to do; 0 if set-up can go on."""
    if sys.version_info[:2] != (3, 11):
        found = ".".join(map(str, sys.version_info[:3]))
        print(
            f"surefoot: this is Python {found}, but PyBullet has wheels up to 3.11 only; install 3.11 "
            "(apt-get install python3.11 python3.11-venv) and run: make PYTHON=python3.11 setup",
            file=sys.stderr,
        )
        return 2
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
