"""The physics engines by name; one is loaded only when a body starts in it."""

from __future__ import annotations

import importlib.util

from perception.primitives.errors import SurefootError

from ... import bullet
from .mujoco_engine import MujocoPhysics
from .physics import Physics, Stage
from .pybullet_engine import PyBulletPhysics


def require(engine: str) -> None:
    """Check, without loading it, that an engine is installed.

    Args:
        engine: One of `physics.ENGINES`.

    Raises:
        SurefootError: It is not installed.
    """
    if engine == "pybullet":
        bullet.require()
    elif importlib.util.find_spec("mujoco") is None:
        raise SurefootError(
            "robot.dynamic.engine='mujoco' needs MuJoCo, which is not installed; run: pip install 'surefoot[physics]'"
        )


def begin(engine: str, stage: Stage) -> Physics:
    """Place the robot in an engine; close it in the end.

    Args:
        engine: One of `physics.ENGINES`.
        stage: What is simulated.

    Raises:
        SurefootError: The engine is not installed.
    """
    require(engine)
    return MujocoPhysics(stage) if engine == "mujoco" else PyBulletPhysics(stage)
