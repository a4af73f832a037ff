"""Options that several verbs share, and the configuration that follows from them."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from perception.primitives.errors import InputError

if TYPE_CHECKING:
    from ..config.schema import Config
    from ..results.run_folder import RunFolder


class Place(click.Path):
    """A path, existing or not; refuses a name that no file can have."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path; InputError for a name that is empty or too long, or a loop of links."""
        if not str(value):
            raise InputError("an empty path was given; expected the name of a file or folder")
        try:
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                os.stat(value)
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise InputError(f"path {shortened(value)} cannot be used: {reason}") from error
        return super().convert(value, param, ctx)


class Number(click.FloatRange):
    """A number within a range; refuses NaN, which click accepts."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number; a usage error for NaN."""
        found = float(super().convert(value, param, ctx))
        if math.isnan(found):
            self.fail(f"{value} is not a number", param, ctx)
        return found


def shortened(path: object) -> str:
    """A path in quotes, its middle left out if it is long."""
    words = repr(str(path))
    return words if len(words) <= MOST_SHOWN else f"{words[:60]}...{words[-20:]}"


MOST_SHOWN = 300  # letters of a path in a message
PATH = Place()
READER = "surefoot.reader"

out_option = click.option(
    "--out", type=PATH, help="Output folder, default runs/NAME-N; an older run there is replaced."
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one setting, such as reach.tof.farthest_m=2.5; may be repeated.",
)
config_option = click.option(
    "--config", "config_path", type=PATH, help="TOML file of settings; any may be left out."
)


def _keep_reader(context: click.Context, parameter: click.Parameter, value: str | None) -> None:
    context.meta[READER] = value


reader_option = click.option(
    "--reader",
    metavar="NAME",
    expose_value=False,
    callback=_keep_reader,
    help="Your own reader of recordings, package.module:Class.",
)


def description_option(verb: Callable[..., None]) -> Callable[..., None]:
    """The options that say how to read a recording: --description and --reader."""
    described = click.option(
        "--description", type=PATH, help="A recording.toml that is not in the recording's folder."
    )
    return described(reader_option(verb))


ignore_poses_option = click.option(
    "--ignore-poses",
    is_flag=True,
    help="Estimate the trajectory without the poses of the recording; keep them as its truth.",
)


smooth_option = click.option(
    "--smooth",
    "smooth_lag_s",
    type=Number(min=0.0, min_open=True),
    metavar="SECONDS",
    help="Also write smoothed.txt: each pose with the measurements up to this much later; inf: with all.",
)


def settings(
    recording: Path | None, config_path: Path | None, overrides: tuple[str, ...], ignore_poses: bool
) -> Config:
    """The configuration that the options ask for.

    Without --config, a recording of `simulate --record` is processed with the settings of that walk.

    Args:
        recording: Of a single run; None for a batch.
        config_path: Of --config.
        overrides: Of --set.
        ignore_poses: Whether --ignore-poses was given.
    """
    from ..config.load import load, own_settings

    if recording is not None and config_path is None:
        config_path = own_settings(recording)
    return load(config_path, all_overrides(overrides, ignore_poses))


def all_overrides(overrides: tuple[str, ...], ignore_poses: bool) -> tuple[str, ...]:
    """The values of --set, and as such those of --ignore-poses and --reader."""
    if ignore_poses:
        overrides = (*overrides, "ignore_poses=true")
    reader = click.get_current_context().meta.get(READER)
    return overrides if reader is None else (*overrides, f"reader={reader}")


def against_truth(folder: RunFolder) -> str:
    """Error of a camera trajectory against the poses that were ignored, as one line."""
    from ..evaluation.evaluate import evaluate
    from ..offline.job import TRUTH
    from ..store.run_tables import write_run_tables

    metrics = evaluate(folder, folder.path(TRUTH))
    write_run_tables(folder)
    if "ate_m" not in metrics:
        return "against the poses of the recording: too few poses to compare"
    return (
        f"against the poses of the recording: {metrics['ate_m']:.3f} m, "
        f"{metrics['ate_deg']:.2f} deg (RMS, {metrics['matched_poses']:.0f} poses, aligned)"
    )
