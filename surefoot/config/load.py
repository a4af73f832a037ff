"""The configuration of a run from a file and single values."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from . import toml
from .presets import by_one_camera, fitted
from .schema import Config

DECIDING = ("scene", "robot", "mission")
"""Parts of a configuration that choose the defaults of the others."""


def own_settings(recording: Path) -> Path | None:
    """The settings that a recording of `simulate --record` was walked with; None for any other."""
    own = recording / "config.toml"
    return own if own.is_file() and (recording / "recording.mcap").is_file() else None


def load(
    path: Path | None,
    overrides: Sequence[str] = (),
    scene: str | None = None,
    seed: int | None = None,
) -> Config:
    """The configuration of a run: defaults for its body and planner, then the file, then single values, scene and seed.

    Args:
        path: TOML file; None for the defaults.
        overrides: Single values such as "reach.tof.farthest_m=2.5".
        scene: Name of the scene; None: as configured.
        seed: Of everything random; None: as configured.

    Raises:
        InputError, ConfigError: The file cannot be read, a key is unknown, a value impossible.
    """
    asked = Config() if path is None else toml.read(Config, path, parts=DECIDING)
    about = [
        one for one in overrides if one.partition(".")[0].partition("=")[0].strip() in DECIDING
    ]
    asked = toml.override(asked, about)
    begun = Config(robot=asked.robot)
    if asked.mission.planner == "swarm":
        begun = by_one_camera(begun, asked.scene if scene is None else scene)
    config = fitted(begun)
    if path is not None:
        config = toml.read(Config, path, config)
    config = toml.override(config, overrides)
    if scene is not None:
        config = dataclasses.replace(config, scene=scene)
    if seed is not None:
        config = dataclasses.replace(config, seed=seed)
    return config
