"""PyBullet, which renders the camera images and by default simulates the dynamic body, is imported here only."""

from __future__ import annotations

import importlib.util
import sys
from typing import Any

from perception.primitives.errors import SurefootError

LAST_PYTHON = (3, 11)  # the last one that PyBullet has a wheel for


def library() -> Any:
    """PyBullet. Call it with standard output silenced: it prints a line while it loads.

    Raises:
        SurefootError: PyBullet is not installed.
    """
    require()
    import pybullet

    return pybullet


def connect(pybullet: Any) -> int:
    """A new client without a window. PyBullet would keep every mesh that it loads, by the name of the file.

    Its EGL plugin has a copy of that list, which cannot be switched off: some 60 bytes a vertex.
    """
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setPhysicsEngineParameter(enableFileCaching=0, physicsClientId=client)
    return int(client)


def require() -> None:
    """Check, without loading it, that PyBullet is installed.

    Raises:
        SurefootError: PyBullet is not installed.
    """
    if importlib.util.find_spec("pybullet") is not None:
        return
    advice = "is not installed; run: pip install pybullet"
    if sys.version_info[:2] > LAST_PYTHON:
        advice = "has no wheel for Python {}.{}; install surefoot under Python 3.11".format(
            *sys.version_info
        )
    raise SurefootError(
        f"the simulation needs PyBullet, which {advice}. Recordings are processed and evaluated without it"
    )
