"""The verbs of the command line as functions that return runs."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import tomli_w

from perception.primitives.errors import InputError

from ..config.load import load, own_settings
from ..config.schema import Config
from ..progress import Say, silent
from . import checks
from .run_results import Run, opened

Place = str | Path


def simulate(
    scene: str | None = None,
    *,
    planner: str | type | None = None,
    gaze: str | type | None = None,
    body: str | None = None,
    seed: int | None = None,
    seconds: float | None = None,
    record: bool = False,
    config: Config | Place | None = None,
    settings: Mapping[str, Any] | None = None,
    out: Place | None = None,
    say: Say | None = None,
) -> Run:
    """Walk a simulated humanoid through a scene, from its sensors alone.

    Args:
        scene: Name of a shipped scene or path of a scene file; None: "home", or that of `config`.
        planner: "search", "field", "swarm", "avoidance" or "footholds" (scenes of several levels),
            "package.module:Class", or a class of your own (see `surefoot.Planner`).
        gaze: "evaluations", "seed", "sweep" or "fixed", "package.module:Class", or a class of your own (see
            `surefoot.GazePolicy`).
        body: "kinematic" or "dynamic".
        seed: Of scene, noise and random choices.
        seconds: End of the run, s of the simulation.
        record: Keep the sensor data as recording.mcap.
        config: Settings, or a TOML file of them; None for the defaults.
        settings: Single settings, such as {"reach.tof.farthest_m": 2.5}; they go before `config`.
        out: Run folder; None for a temporary one.
        say: Takes lines of progress.

    Raises:
        InputError: Unknown scene, planner or setting, or a plug-in that cannot be loaded.
        OutputError: The folder cannot be written.
    """
    from ..run.simulate import simulate as run

    chosen: dict[str, Any] = {}
    if planner is not None:
        chosen["mission.planner"] = checks.plugin(planner, "planner")
    if gaze is not None:
        chosen["gaze.mode"] = checks.plugin(gaze, "gaze")
    if body is not None:
        chosen["robot.body"] = body
    if seconds is not None:
        chosen["mission.time_limit_s"] = checks.positive(seconds, "seconds")
    checks.optional(scene, str, "scene")
    if seed is not None:
        seed = checks.whole(seed, "seed")
    asked = configuration(config, {**_given(settings), **chosen}, scene, seed)
    folder, temporary = _folder(out)
    run(asked, folder, record, say or silent)
    return opened(folder, temporary)


def process(
    recording: Place,
    *,
    description: Place | None = None,
    config: Config | Place | None = None,
    settings: Mapping[str, Any] | None = None,
    out: Place | None = None,
    say: Say | None = None,
) -> Run:
    """Process a recording: poses, floor, obstacles, tracks and maps.

    Args:
        recording: Folder or file, of any format that `surefoot process --help` lists.
        description: A recording.toml kept elsewhere.
        config: Settings, or a TOML file of them; None for those a recorded run was walked with, else the
            defaults.
        settings: Single settings, such as {"reach.tof.farthest_m": 2.5}; they go before `config`.
        out: Run folder; None for a temporary one.
        say: Takes lines of progress.

    Raises:
        RecordingError: The recording cannot be read.
        InputError: A setting is unknown or impossible.
        OutputError: The folder cannot be written.
    """
    from ..run.process import process as run

    path = checks.path(recording, "recording")
    asked = configuration(own_settings(path) if config is None else config, _given(settings))
    folder, temporary = _folder(out)
    run(path, _path(description, "description"), asked, folder, say or silent)
    return opened(folder, temporary)


def map(
    recording: Place,
    *,
    description: Place | None = None,
    config: Config | Place | None = None,
    settings: Mapping[str, Any] | None = None,
    out: Place | None = None,
    say: Say | None = None,
) -> Run:
    """Map a whole recording: camera trajectory with loop closure, surface, and where a robot can walk.

    Arguments and errors as for `process`. The surface is `run.path("mesh.ply")`, the maps are `run.map` and
    `run.layers`; "surface.voxel_m" sets the resolution.
    """
    from ..offline.map import map_recording

    return _offline("map", map_recording, recording, description, config, settings, out, say)


def panorama(
    recording: Place,
    *,
    description: Place | None = None,
    config: Config | Place | None = None,
    settings: Mapping[str, Any] | None = None,
    out: Place | None = None,
    say: Say | None = None,
) -> Run:
    """Stitch the views of a recording to one panoramic map, and find obstacles and gaps in it.

    Arguments and errors as for `process`. The results are `run.path("panorama.json")` and
    `run.path("panorama.npz")`.
    """
    from ..offline.panorama import run_panorama

    return _offline("panorama", run_panorama, recording, description, config, settings, out, say)


def monocular(
    recording: Place,
    *,
    description: Place | None = None,
    config: Config | Place | None = None,
    settings: Mapping[str, Any] | None = None,
    out: Place | None = None,
    say: Say | None = None,
) -> Run:
    """Find the floor of a recording by colour alone; compared with depth where there is any.

    Arguments and errors as for `process`. The figures are in `run.summary`, the pictures in `run.folder`.
    """
    from ..offline.monocular import run_monocular

    return _offline("monocular", run_monocular, recording, description, config, settings, out, say)


def evaluate(
    run: Run | Place,
    truth: Place | None = None,
    *,
    surface: Place | None = None,
    truth_sigma: tuple[float, float] = (0.0, 0.0),
) -> Run:
    """Compare a run with the truth: errors, consistency, map, contacts.

    Writes metrics.json and the report anew.

    Args:
        run: A run or its folder.
        truth: Trajectory in TUM text; None for the run's own truth/.
        surface: Mesh or cloud of the true surfaces.
        truth_sigma: Standard deviations of the given truth itself, m and rad.

    Returns:
        The run; the figures are its `metrics`.

    Raises:
        InputError: There is no such run, or the truth cannot be read.
        OutputError: The folder cannot be written.
    """
    from ..evaluation.evaluate import evaluate as measure
    from ..report.page import write_report
    from ..results.run_folder import RunFolder
    from ..store.run_tables import write_run_tables

    given, shape = _path(truth, "truth"), _path(surface, "surface")
    sigma_m, sigma_rad = checks.numbers(truth_sigma, (2,), "truth_sigma")
    judged = run if isinstance(run, Run) else Run(checks.path(run, "run"))
    folder = RunFolder.open(judged.folder)
    measure(folder, given, shape, (float(sigma_m), float(sigma_rad)))
    write_report(folder)
    write_run_tables(folder)
    return judged


def _offline(
    verb: str,
    work: Callable[..., object],
    recording: Place,
    description: Place | None,
    config: Config | Place | None,
    settings: Mapping[str, Any] | None,
    out: Place | None,
    say: Say | None,
) -> Run:
    from ..offline.job import Job

    path = checks.path(recording, "recording")
    asked = configuration(own_settings(path) if config is None else config, _given(settings))
    folder, temporary = _folder(out)
    work(Job.open(verb, path, _path(description, "description"), asked, folder), say or silent)
    return opened(folder, temporary)


def configuration(
    config: Config | Place | None,
    settings: Mapping[str, Any],
    scene: str | None = None,
    seed: int | None = None,
) -> Config:
    """The configuration, with single settings, scene and seed.

    Raises:
        InputError: A file that cannot be read, or a setting that is unknown or impossible.
    """
    changes = [f"{key}={_value(key, value)}" for key, value in settings.items()]
    if isinstance(config, Config):
        from dataclasses import replace

        from ..config import toml

        changed = toml.override(config, changes)
        changed = changed if scene is None else replace(changed, scene=scene)
        return changed if seed is None else replace(changed, seed=seed)
    return load(_path(config, "config"), changes, scene, seed)


def _given(settings: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Single settings, of which there may be none."""
    return {} if settings is None else checks.instance(settings, Mapping, "settings")  # type: ignore[type-abstract]


def _path(value: Place | None, what: str) -> Path | None:
    """A path that may be missing."""
    return None if value is None else checks.path(value, what)


def _value(key: str, value: Any) -> str:
    """A value as TOML."""
    try:
        return tomli_w.dumps({"v": checks.plain(value)}).partition("=")[2].strip()
    except TypeError as error:
        raise InputError(f"setting {key}={value!r}: {error}") from error


def _folder(out: Place | None) -> tuple[Path, tempfile.TemporaryDirectory[str] | None]:
    if out is not None:
        return checks.path(out, "out"), None
    temporary = tempfile.TemporaryDirectory(prefix="surefoot-")
    return Path(temporary.name) / "run", temporary
