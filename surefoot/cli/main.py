"""The command line: the verbs, and what each prints.

Heavy packages are imported inside the verbs, so that help answers at once.
"""

from __future__ import annotations

import json
import logging
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from perception.primitives.errors import InputError

from .terminal import FAILED, Verbs, progress

if TYPE_CHECKING:
    from ..config.schema import Config
    from ..run.summary import Summary

for _variable in (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
):  # small matrices: one thread is faster
    os.environ.setdefault(_variable, "1")
os.environ.setdefault("NUMBA_THREADING_LAYER", "workqueue")


@click.group(cls=Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--debug", is_flag=True, help="Show the full trace of unexpected errors.")
@click.version_option(package_name="surefoot")
def main(debug: bool) -> None:
    """A humanoid robot sees where it may step.

    \b
    Walk through a simulated home, and keep a recording:
      surefoot simulate home --seed 3 --record --out runs/home3
    Process a recording (yours or that one), and see how good it is:
      surefoot process runs/home3 --out runs/offline
      surefoot evaluate runs/offline
      surefoot view runs/offline
    """
    logging.basicConfig(level=logging.WARNING)
    for package in ("perception", "mapping", "planning", "sim", "surefoot"):
        logging.getLogger(package).setLevel(logging.DEBUG if debug else logging.WARNING)
    logging.getLogger("matplotlib").setLevel(
        logging.ERROR
    )  # it warns about a home that it cannot write


out_option = click.option(
    "--out", type=click.Path(path_type=Path), help="Run folder to write; default runs/NAME-N."
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one value, grid.cell_m=0.02.",
)
config_option = click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path),
    help="TOML file; any part may be left out.",
)


@main.command()
@click.argument("scene", required=False)
@click.option("--seed", type=click.IntRange(min=0), help="Of scene, noise and choices.")
@click.option(
    "--difficulty", type=click.FloatRange(0.0, 1.0), help="Of the scene: 0 easy, 0.5 usual, 1 hard."
)
@click.option(
    "--planner",
    metavar="NAME",
    help="Who decides the steps: search (the joint stack), field, swarm or avoidance.",
)
@click.option(
    "--body",
    type=click.Choice(["kinematic", "dynamic"]),
    help="Exact footsteps with drawn noise, or servos and soles in a physical world.",
)
@click.option("--record", is_flag=True, help="Keep the sensors in recording.mcap.")
@click.option("--view", "watch", is_flag=True, help="Live page on loopback (needs the extra viz).")
@click.option(
    "--wander",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="SECONDS",
    help="Explore for so long instead of walking to a goal.",
)
@out_option
@config_option
@set_option
@json_option
def simulate(
    scene: str | None,
    seed: int | None,
    difficulty: float | None,
    planner: str | None,
    body: str | None,
    record: bool,
    watch: bool,
    wander: float | None,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Walk a simulated humanoid through SCENE, from its sensors alone.

    \b
    Examples:
      surefoot simulate                      the furnished home, seed 0
      surefoot simulate home --seed 7 --record --out runs/seven
      surefoot simulate home --wander 300    explore it for five minutes
      surefoot simulate home --difficulty 1  more in the way, narrower and faster
      surefoot simulate --config runs/seven/config.toml     the same again
    """
    from ..config.load import load
    from ..run.simulate import simulate as run

    if difficulty is not None:
        overrides = (*overrides, f"difficulty={difficulty}")
    if planner is not None:
        overrides = (*overrides, f"mission.planner={planner}")
    if body is not None:
        overrides = (*overrides, f"robot.body={body}")
    if wander is not None:
        overrides = (*overrides, "mission.wander=true", f"mission.time_limit_s={wander}")
    config = load(config_path, overrides, scene=scene, seed=seed)
    with progress() as say:
        summary = run(config, out, record, say, watch)
    _close(summary, as_json)


@main.command()
@click.argument(
    "recordings", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="RECORDING..."
)
@click.option(
    "--description",
    type=click.Path(path_type=Path),
    help="A recording.toml kept elsewhere, for a folder you cannot write to.",
)
@click.option("--workers", type=click.IntRange(min=1), help="Processes for many recordings.")
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler to do many recordings.")
@click.option("--resume", is_flag=True, help="Go on where a run into the same --out was killed.")
@out_option
@config_option
@set_option
@json_option
def process(
    recordings: tuple[Path, ...],
    description: Path | None,
    workers: int | None,
    scheduler: str | None,
    resume: bool,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Process RECORDING: a folder, an .mcap, .bag, .db3 or .pcd file; or many, and folders of them.

    \b
    Read are: what `simulate --record` wrote, ROS 1 and ROS 2 bags, TUM RGB-D, ICL-NUIM, 7-Scenes, EuRoC,
    Redwood / Open3D and Replica folders, RealSense folders, organised PCD, and any folder of depth images
    with a recording.toml. Many are processed side by side; started again, the same command goes on.
    Examples:
      surefoot process data/walk
      surefoot process ~/rgbd_dataset_freiburg3_cabinet --out runs/cabinet
      surefoot process ~/recordings --out runs/all --workers 8
    \b
    A single run of `simulate --record` is processed with the settings it was walked with (its config.toml);
    --config takes others.
    """
    from ..config.load import load
    from ..recordings.open import holds_recording
    from ..run.process import process as run

    if resume and out is None:
        raise InputError("--resume needs --out, the folder of the run that was killed")
    one = recordings[0]
    if config_path is None and len(recordings) == 1 and _is_recorded_run(one):
        config_path = one / "config.toml"  # they fit the body that walked
    config = load(config_path, overrides)
    several = one.is_dir() and not holds_recording(one) and description is None and _holds_more(one)
    if len(recordings) > 1 or several or workers or scheduler:
        _process_all(recordings, out, config, workers, scheduler, as_json)
        return
    with progress() as say:
        summary = run(one, description, config, out, say, resume)
    _close(summary, as_json)


@main.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--description", type=click.Path(path_type=Path), help="A recording.toml kept elsewhere."
)
@out_option
@config_option
@set_option
@json_option
def monocular(
    recording: Path,
    description: Path | None,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find the floor of RECORDING by its colour alone, as seed 000 does; depth judges it where there is any.

    Writes the eight stages of every frame as one picture, and monocular.json.

    \b
    Examples:
      surefoot monocular data/walk
      surefoot monocular ~/rgbd_dataset_freiburg3_cabinet --set monocular.farthest_m=4
    """
    from ..config.load import load
    from ..offline.monocular import process_monocular
    from ..recordings.open import open_recording
    from ..results.run_folder import RunFolder

    config = load(config_path, overrides)
    opened = open_recording(recording, description)
    folder = RunFolder.create(out, name=f"{opened.info.name}-monocular", reads=recording)
    with progress() as say:
        figures = process_monocular(opened, folder.root, say, config)
    if as_json:
        click.echo(json.dumps(figures, indent=2))
        return
    judged = (
        f"{figures['judged']} judged by depth, floor IoU {figures['iou']:.3f}"
        if figures["judged"]
        else "no depth to judge them by"
    )
    for reason, count in figures["skipped"].items():
        click.echo(f"skipped {count}: {reason}")
    click.echo(f"{figures['frames']} frames, {judged}: {folder.root}")


@main.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--views", type=click.IntRange(min=1), help="At most so many; default 40.")
@click.option("--by-pictures", is_flag=True, help="Do not use where the camera is known to be.")
@out_option
@config_option
@set_option
@json_option
def panorama(
    recording: Path,
    views: int | None,
    by_pictures: bool,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Lay the views of RECORDING together to one panoramic map, as seed 004 does, and list what stands there.

    Writes panorama.ply, panorama.npz, panorama.json and a picture of obstacles and gaps.
    """
    from ..config.load import load
    from ..offline.panorama import GatherConfig, run_panorama
    from ..recordings.open import open_recording
    from ..results.run_folder import RunFolder

    opened = open_recording(recording)
    folder = RunFolder.create(out, name=f"{opened.info.name}-panorama")
    wanted = GatherConfig() if views is None else GatherConfig(most=views)
    with progress() as say:
        told = run_panorama(
            opened, folder.root, say, load(config_path, overrides), wanted, by_pictures
        )
    if as_json:
        click.echo(json.dumps(told, indent=2))
        return
    placed = sum(view["placed"] for view in told["views"])
    unseen = (
        "" if told["floor_seen"] else ", floor not seen (heights rest on where it was expected)"
    )
    click.echo(
        f"{placed} of {len(told['views'])} views, {len(told['obstacles'])} obstacles{unseen}: "
        f"{folder.root}"
    )


@main.command(name="map")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--description", type=click.Path(path_type=Path), help="A recording.toml kept elsewhere."
)
@click.option("--voxel", type=click.FloatRange(min=0.002), help="Of the surface, m; default 0.02.")
@out_option
@config_option
@set_option
@json_option
def map_whole(
    recording: Path,
    description: Path | None,
    voxel: float | None,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Map the whole of RECORDING: the camera's way with loops closed, mesh, and where one can walk.

    \b
    Poses in the recording are taken; without them odometry and places known again find the way.
    Examples:
      surefoot map ~/7scenes/redkitchen/seq-01 --out runs/kitchen
      surefoot map office.bag --voxel 0.01
    """
    from dataclasses import asdict

    from mapping.surface.tsdf_config import TsdfConfig

    from ..config.load import load
    from ..offline.map import map_recording
    from ..recordings.open import open_recording

    config = load(config_path, overrides)
    surface = TsdfConfig() if voxel is None else TsdfConfig(voxel_m=voxel)
    with progress() as say:
        mapped = map_recording(open_recording(recording, description), out, config, say, surface)
    click.echo(json.dumps(asdict(mapped), indent=2) if as_json else "\n".join(mapped.lines()))


@main.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--truth",
    type=click.Path(path_type=Path),
    help="Trajectory in TUM text; default the run's own truth/.",
)
@click.option(
    "--surface",
    type=click.Path(path_type=Path),
    help="Mesh or cloud of the true surfaces, in the frame of the run; with --truth, in the truth's.",
)
@click.option(
    "--truth-sigma",
    nargs=2,
    type=click.FloatRange(min=0.0),
    default=(0.0, 0.0),
    metavar="M DEG",
    help="How good the given truth itself is: deviation of its positions and of its turns.",
)
@json_option
def evaluate(
    run: Path,
    truth: Path | None,
    surface: Path | None,
    truth_sigma: tuple[float, float],
    as_json: bool,
) -> None:
    """Hold RUN against the truth: errors, consistency, map, contacts; writes metrics and report."""
    from ..evaluation.evaluate import evaluate as measure
    from ..evaluation.targets import closing_table
    from ..report.page import write_report
    from ..results.run_folder import RunFolder

    folder = RunFolder.open(run)
    metres, degrees = truth_sigma
    metrics = measure(folder, truth, surface, (metres, math.radians(degrees)))
    report = write_report(folder)
    if as_json:
        click.echo(json.dumps(metrics, indent=2))
    else:
        click.echo(closing_table(metrics))
        click.echo(f"report: {report}")


@main.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--lag",
    "lag_s",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="SECONDS",
    help="How far each pose may look ahead; default to the end of the run.",
)
def smooth(run: Path, lag_s: float | None) -> None:
    """Smooth the poses of RUN by all that came after them; writes smoothed.txt with its covariances.

    \b
    Examples:
      surefoot smooth runs/three             every pose by the whole run
      surefoot smooth runs/three --lag 10    as a robot could ten seconds later
    """
    from ..offline.smooth import smooth_run
    from ..results.run_folder import RunFolder

    folder = RunFolder.open(run)
    poses = smooth_run(folder, lag_s)
    click.echo(f"{len(poses)} poses: {folder.path('smoothed.txt')}")


@main.command()
@click.argument("identity", metavar="ID", required=False)
@click.option("--seeds", type=click.IntRange(min=1), help="How many random worlds.")
@click.option(
    "--body",
    type=click.Choice(["kinematic", "dynamic", "both"]),
    help="Who walks, where somebody does; both: beside each other.",
)
@click.option("--resume", is_flag=True, help="Go on where the same study was killed.")
@json_option
def experiment(
    identity: str | None, seeds: int | None, body: str | None, resume: bool, as_json: bool
) -> None:
    """Measure a published table or figure again; without ID, list them.

    \b
    Examples:
      surefoot experiment 003-E2               figures, targets and the paper's own numbers
      surefoot experiment 001-E3 --seeds 20    on fewer random worlds
      surefoot experiment INT-4 --resume       what was walked before it was killed is not walked again
    """
    from ..experiments.support import experiment as experiments
    from ..experiments.support import trials

    if identity is None:
        for name in experiments.names():
            click.echo(f"{name:<14} {experiments.load(name).title}")
        return
    chosen = experiments.load(identity)
    shelf = trials.Shelf(Path("runs") / "experiments" / identity, resume)
    with progress() as say, trials.kept(shelf):
        chosen, outcome = experiments.measure(chosen, say, seeds, body)
    result = experiments.judge(chosen, outcome)
    shown = (
        json.dumps(result, indent=2)
        if as_json
        else "\n".join(experiments.lines(result, outcome.table))
    )
    click.echo(shown)
    if not result["passed"]:
        click.get_current_context().exit(FAILED)


@main.command()
@click.argument("name", required=False)
@json_option
def bench(name: str | None, as_json: bool) -> None:
    """Time our hot paths against their named peers; without NAME, all of them."""
    from ..benchmarks import benchmark

    passed, results = True, []
    for one in [name] if name else benchmark.names():
        chosen = benchmark.load(one)
        results.append(benchmark.judge(chosen, chosen.run()))
        passed = passed and results[-1]["passed"]
        if not as_json:
            click.echo("\n".join(benchmark.lines(results[-1])))
    if as_json:
        click.echo(json.dumps(results[0] if name else results, indent=2))
    if not passed:
        click.get_current_context().exit(FAILED)


@main.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--live", is_flag=True, help="3-D page on loopback (needs the extra viz).")
def view(run: Path, live: bool) -> None:
    """Open the report of RUN; with --live, its map and cloud as a 3-D page."""
    from ..results.run_folder import RunFolder

    folder = RunFolder.open(run)
    if live:
        from ..report.live_view import serve

        serve(folder, click.echo)
        return
    report = folder.path("report.html")
    if not report.is_file():
        from ..report.page import write_report

        report = write_report(folder)
    click.echo(f"report: {report}")
    click.launch(str(report))


@main.command()
@json_option
def doctor(as_json: bool) -> None:
    """Show what was found on this machine, and what each missing piece costs."""
    from .doctor import examine, render

    findings = examine()
    if as_json:
        from dataclasses import asdict

        click.echo(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        click.echo(render(findings))


@main.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of SHELL; source it in the shell's start-up file."""
    from click.shell_completion import get_completion_class

    found = get_completion_class(shell)
    assert found is not None
    click.echo(found(main, {}, "surefoot", "_SUREFOOT_COMPLETE").source())


def _is_recorded_run(place: Path) -> bool:
    return all((place / name).is_file() for name in ("recording.mcap", "config.toml"))


def _holds_more(place: Path) -> bool:
    from ..recordings.open import holds_recording

    return any(holds_recording(child) for child in place.rglob("*") if child.is_dir())


def _process_all(
    recordings: tuple[Path, ...],
    out: Path | None,
    config: Config,
    workers: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    from dataclasses import asdict

    from ..run import batch

    folder = out or Path("runs") / "batch"
    with progress() as say:
        rows = batch.process_all(recordings, folder, config, say, workers, scheduler)
    if as_json:
        click.echo(json.dumps([asdict(row) for row in rows], indent=2))
    else:
        click.echo("\n".join([*batch.lines(rows), f"table: {folder / batch.TABLE}"]))
    if any(row.status == batch.FAILED for row in rows):
        click.get_current_context().exit(FAILED)


def _close(summary: Summary, as_json: bool) -> None:
    """What a run ended with: for people a few lines, for machines one object."""
    if as_json:
        click.echo(json.dumps(summary.as_dict(), indent=2))
    else:
        click.echo("\n".join(summary.lines()))
    if not summary.succeeded:
        click.get_current_context().exit(FAILED)
