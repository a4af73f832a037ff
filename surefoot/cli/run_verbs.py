"""Verbs that run the pipeline: simulate, process, and smooth the result."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from perception.primitives.errors import InputError

from ..words import count_of
from .batch_verbs import Workers, seeds_of, simulate_all, workers_options
from .options import (
    PATH,
    Number,
    against_truth,
    config_option,
    description_option,
    ignore_poses_option,
    json_option,
    out_option,
    set_option,
    settings,
    smooth_option,
)
from .terminal import FAILED, INTERRUPTED, open_in_browser, progress

if TYPE_CHECKING:
    from ..report.live_view import LivePage
    from ..run.summary import Summary


@click.command()
@click.argument("scene", required=False)
@click.option(
    "--seed", type=click.IntRange(min=0), help="Seed of the scene and of all random noise."
)
@click.option(
    "--difficulty",
    type=click.FloatRange(0.0, 1.0),
    help="Difficulty of the scene: 0 easy, 0.5 usual, 1 hard.",
)
@click.option(
    "--planner",
    metavar="NAME",
    help="Planner: search, field, swarm, avoidance, footholds (on several levels), or your own package.module:Class.",
)
@click.option(
    "--gaze",
    metavar="NAME",
    help="Gaze policy: evaluations, seed, sweep, fixed, or your own package.module:Class.",
)
@click.option(
    "--body",
    type=click.Choice(["kinematic", "dynamic"]),
    help="kinematic: exact footsteps with odometry noise; dynamic: servos and contacts in physics.",
)
@click.option(
    "--robot",
    metavar="NAME",
    help="Robot: surefoot, g1, talos, icub, or the .toml file of your own (docs/howto/robots.md).",
)
@click.option("--record", is_flag=True, help="Write the sensor data to recording.mcap.")
@click.option(
    "--view",
    "watch",
    is_flag=True,
    help="Show the walk in the browser while it goes on, and afterwards until Ctrl-C.",
)
@click.option(
    "--wander",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="SECONDS",
    help="Explore for this time instead of walking to a goal.",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="NAME[:VALUE]",
    help="Fault of a sensor, the clock or a foot, from 8 to 14 s; may be repeated (docs/howto/faults.md).",
)
@click.option(
    "--seeds",
    callback=seeds_of,
    metavar="A:B",
    help="A batch: one walk for each seed from A to B - 1; goes with --out and the options of `surefoot batch`.",
)
@smooth_option
@out_option
@config_option
@set_option
@workers_options
@json_option
def simulate(
    scene: str | None,
    seed: int | None,
    difficulty: float | None,
    planner: str | None,
    gaze: str | None,
    body: str | None,
    robot: str | None,
    record: bool,
    watch: bool,
    wander: float | None,
    faults: tuple[str, ...],
    seeds: range | None,
    smooth_lag_s: float | None,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    workers: Workers,
    as_json: bool,
) -> None:
    """Walk a simulated humanoid through SCENE by its sensors alone.

    \b
    Examples:
      surefoot simulate                      the furnished home, seed 0
      surefoot simulate home --seed 7 --record --out runs/seven
      surefoot simulate home --wander 300    explore for five minutes
      surefoot simulate home --robot g1      a Unitree G1 (pip install 'surefoot[robots]')
      surefoot simulate storeys --robot g1   up a flight of stairs, by its depth camera and joints
      surefoot simulate home --difficulty 1  more obstacles, narrower and faster
      surefoot simulate home --fault frozen --fault dropped:0.2     what the robot notices, and does
      surefoot simulate home --seeds 1000:2000 --out runs/homes     a thousand homes, as a batch
      surefoot simulate --config runs/seven/config.toml     repeat a run
    """
    from ..config.load import load
    from ..run.simulate import simulate as run

    if difficulty is not None:
        overrides = (*overrides, f"difficulty={difficulty}")
    if planner is not None:
        overrides = (*overrides, f"mission.planner={planner}")
    if gaze is not None:
        overrides = (*overrides, f"gaze.mode={gaze}")
    if body is not None:
        overrides = (*overrides, f"robot.body={body}")
    if robot is not None:
        overrides = (*overrides, f"robot.model={robot}")
    if wander is not None:
        overrides = (*overrides, "mission.wander=true", f"mission.time_limit_s={wander}")
    if faults:
        overrides = (*overrides, f"faults.inject={json.dumps(faults)}")
    if seeds is not None:
        if watch or smooth_lag_s is not None or seed is not None or out is None:
            raise InputError(
                "--seeds needs --out, and goes with neither --seed nor --view nor --smooth"
            )
        load(config_path, overrides, scene=scene)  # what is wrong is said once
        simulate_all(scene, seeds, out, config_path, overrides, record, workers, as_json)
        return
    config = load(config_path, overrides, scene=scene, seed=seed)
    page = _live_page() if watch else None
    with progress() as say:
        summary = run(config, out, record, say, page)
    _smooth(summary, smooth_lag_s)
    _tell(summary, as_json)
    if page is not None and not summary.interrupted:
        click.echo(f"{page.address} shows the whole walk until Ctrl-C", err=True)
        page.stay()
    _close(summary, "")


@click.command()
@click.argument("hours", type=click.FloatRange(min=0.0, min_open=True))
@click.option("--out", type=PATH, default=Path("runs") / "soak", show_default=True,
              help="Folder of soak.csv; a soak in it goes on.")  # fmt: skip
@config_option
@set_option
@json_option
def soak(
    hours: float,
    out: Path,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Walk through random scenes with random faults for HOURS; watch memory, latency, contacts and NEES.

    \b
    Examples:
      surefoot soak 2                                  leaves runs/soak/soak.csv
      surefoot soak 8                                  goes on there, to eight hours
      surefoot soak 1 --set mission.time_limit_s=60    short walks
    """
    from ..config.load import load
    from ..run import soak as soaking

    with progress() as say:
        walks = soaking.soak(hours, out, load(config_path, overrides), say)
    figures = soaking.figures(walks)
    shown = [*soaking.lines(walks), f"table: {out / soaking.TABLE}"]
    click.echo(json.dumps(figures, indent=2) if as_json else "\n".join(shown))
    if figures["contacts"] or figures["falls"]:
        click.get_current_context().exit(FAILED)


@click.command()
@click.argument("recording", type=PATH)
@description_option
@ignore_poses_option
@click.option(
    "--resume",
    is_flag=True,
    help="Continue an interrupted or killed run into the same --out.",
)
@smooth_option
@out_option
@config_option
@set_option
@json_option
def process(
    recording: Path,
    description: Path | None,
    ignore_poses: bool,
    resume: bool,
    smooth_lag_s: float | None,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Process RECORDING: a folder, or an .mcap, .bag, .db3 or .pcd file.

    \b
    It reads recordings of `simulate --record`, ROS 1 and ROS 2 bags, TUM RGB-D, ETH3D, ICL-NUIM, 7-Scenes, ScanNet, EuRoC,
    KITTI, Redwood / Open3D, RealSense and Replica folders, rectified stereo pairs, organised PCD files, and any
    folder of depth images with a recording.toml. It also reads logs of wheeled robots, and localises them: MRCLAM folders (or one robot's
    Robot<n>_Odometry.dat) and Plaza .mat files. `surefoot batch process` does many.
    Examples:
      surefoot process data/walk
      surefoot process ~/rgbd_dataset_freiburg3_cabinet --out runs/cabinet
      surefoot process ~/rgbd_dataset_freiburg3_cabinet --ignore-poses
      surefoot batch process ~/recordings --out runs/all
      surefoot process data/walk --smooth inf          poses smoothed over the whole walk (GTSAM)
    \b
    A recording of `simulate --record` has by default the settings with which it was walked (its config.toml).
    """
    from ..results.run_folder import RunFolder
    from ..run.process import process as run

    if resume and out is None:
        raise InputError("--resume needs --out, the folder of the interrupted run")
    config = settings(recording, config_path, overrides, ignore_poses)
    with progress() as say:
        summary = run(recording, description, config, out, say, resume)
    _smooth(summary, smooth_lag_s)
    words = ["surefoot", "process", str(recording), "--out", str(summary.folder), "--resume"]
    words += ["--config", str(summary.folder / "config.toml")]
    if description is not None:
        words += ["--description", str(description)]
    if config.ignore_poses and not as_json:
        click.echo(against_truth(RunFolder(summary.folder)))
    _tell(summary, as_json)
    _close(summary, f"; continue with: {shlex.join(words)}")


@click.command()
@click.argument("run", type=PATH)
@click.option(
    "--lag",
    "lag_s",
    type=Number(min=0.0, min_open=True),
    metavar="SECONDS",
    help="Later measurements that each pose may use; default all of the run.",
)
def smooth(run: Path, lag_s: float | None) -> None:
    """Smooth the poses of RUN by its later measurements; writes smoothed.txt and its covariances.

    \b
    Examples:
      surefoot smooth runs/three             each pose by the whole run
      surefoot smooth runs/three --lag 10    as a robot could ten seconds later
    """
    from ..offline.smooth import smooth_run
    from ..results.run_folder import RunFolder

    folder = RunFolder.open(run)
    poses = smooth_run(folder, lag_s)
    click.echo(f"{len(poses)} poses: {folder.path('smoothed.txt')}")


def _smooth(summary: Summary, lag_s: float | None) -> None:
    """Smooth the poses of a complete run, if --smooth was given."""
    from ..offline.smooth import smooth_run
    from ..results.run_folder import RunFolder

    if lag_s is not None and not summary.interrupted:
        smooth_run(RunFolder(summary.folder), None if math.isinf(lag_s) else lag_s)


def _live_page() -> LivePage:
    from ..report.live_view import LivePage

    page = LivePage()
    click.echo(f"watch the walk: {page.address}", err=True)
    open_in_browser(page.address)
    return page


def _tell(summary: Summary, as_json: bool) -> None:
    """Print the summary of a run."""
    click.echo(json.dumps(summary.as_dict(), indent=2) if as_json else "\n".join(summary.lines()))


def _close(summary: Summary, resume: str) -> None:
    """Exit with the code of a run."""
    if summary.interrupted:
        click.echo(
            f"interrupted after {count_of(summary.frames, 'frame')}{resume}",
            err=True,
        )
        click.get_current_context().exit(INTERRUPTED)
    if not summary.succeeded:
        click.get_current_context().exit(FAILED)
