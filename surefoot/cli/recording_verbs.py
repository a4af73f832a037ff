"""Verbs on a whole recording, or on several maps: map, merge, panorama, monocular, calibrate-noise."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from ..words import count_of
from .options import (
    PATH,
    against_truth,
    config_option,
    description_option,
    ignore_poses_option,
    json_option,
    out_option,
    set_option,
    settings,
)
from .terminal import DONE, FAILED, progress


@click.command(name="map")
@click.argument("recording", type=PATH)
@description_option
@ignore_poses_option
@click.option(
    "--voxel",
    type=click.FloatRange(min=0.002),
    metavar="METRES",
    help="Voxel size of the surface; short for --set surface.voxel_m.",
)
@out_option
@config_option
@set_option
@json_option
def map_verb(
    recording: Path,
    description: Path | None,
    ignore_poses: bool,
    voxel: float | None,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Map RECORDING: camera trajectory, surface mesh, and where a robot can walk.

    \b
    Poses come from the recording; from footsteps, inertial sensor and landmarks of a walking body; or else
    from RGB-D odometry with loop closure. RECORDING is any that `surefoot process` reads.
    Examples:
      surefoot map data/walk
      surefoot map ~/7scenes/redkitchen/seq-01 --out runs/kitchen
      surefoot map office.bag --voxel 0.01
    """
    from ..offline.job import Job
    from ..offline.map import map_recording

    if voxel is not None:
        overrides = (*overrides, f"surface.voxel_m={voxel}")
    config = settings(recording, config_path, overrides, ignore_poses)
    job = Job.open("map", recording, description, config, out)
    with progress() as say:
        mapped = map_recording(job, say)
    click.echo(json.dumps(asdict(mapped), indent=2) if as_json else "\n".join(mapped.lines()))
    if config.ignore_poses and not as_json:
        click.echo(against_truth(job.folder))


@click.command()
@click.argument("maps", type=PATH, nargs=-1, required=True, metavar="MAP...")
@out_option
@json_option
def merge(maps: tuple[Path, ...], out: Path | None, as_json: bool) -> None:
    """Merge MAPs of one place, each of its own session, into one map.

    \b
    A MAP is a folder of `surefoot map`; its recording is read again. Sessions that show another place stay apart,
    each part with a folder of its own. changes.json says what was moved between two sessions. The order of the
    maps does not matter.
    Examples:
      surefoot merge runs/monday runs/tuesday --out runs/office
      surefoot merge runs/kitchen-*
    """
    from ..offline.merge import merge as merge_maps

    with progress() as say:
        merged = merge_maps(maps, out, say)
    click.echo(json.dumps(asdict(merged), indent=2) if as_json else "\n".join(merged.lines()))


@click.command()
@click.argument("recording", type=PATH)
@description_option
@ignore_poses_option
@click.option(
    "--views",
    type=click.IntRange(min=1),
    help="Largest number of views; short for --set panorama.most_views.",
)
@click.option(
    "--by-pictures",
    is_flag=True,
    help="Place the views without camera poses; short for --set panorama.by_pictures=true.",
)
@out_option
@config_option
@set_option
@json_option
def panorama(
    recording: Path,
    description: Path | None,
    ignore_poses: bool,
    views: int | None,
    by_pictures: bool,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Stitch views of RECORDING to a panoramic map, as seed 004 does, and list its obstacles and gaps.

    Writes panorama.ply, panorama.npz, panorama.json and a picture of obstacles and gaps. RECORDING is any with
    depth that `surefoot process` reads.

    \b
    Examples:
      surefoot panorama data/walk --views 8 --out runs/around
      surefoot panorama my_folder --json
    """
    from ..offline.job import Job, count_reasons
    from ..offline.panorama import panorama_lines, run_panorama

    if views is not None:
        overrides = (*overrides, f"panorama.most_views={views}")
    if by_pictures:
        overrides = (*overrides, "panorama.by_pictures=true")
    config = settings(recording, config_path, overrides, ignore_poses)
    job = Job.open("panorama", recording, description, config, out)
    with progress() as say:
        content = run_panorama(job, say)
    if as_json:
        click.echo(json.dumps(content, indent=2))
        click.get_current_context().exit(FAILED if content["failed"] else DONE)
    for reason, count in count_reasons([one.reason for one in job.recording.skipped]).items():
        click.echo(f"skipped {count}: {reason}")
    click.echo("\n".join([*panorama_lines(content), f"panorama folder: {job.folder.root}"]))
    if content["failed"]:
        click.echo(f"surefoot: {job.recording.info.name}: {content['failed']}", err=True)
        click.get_current_context().exit(FAILED)


@click.command()
@click.argument("recording", type=PATH)
@description_option
@ignore_poses_option
@out_option
@config_option
@set_option
@json_option
def monocular(
    recording: Path,
    description: Path | None,
    ignore_poses: bool,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find the floor of RECORDING by colour alone, as seed 000 does, and compare it with depth if there is any.

    Writes the eight stages of every frame as one picture, and monocular.json. RECORDING is any with colour
    pictures that `surefoot process` reads.

    \b
    Examples:
      surefoot monocular data/walk
      surefoot monocular ~/rgbd_dataset_freiburg3_cabinet --out runs/floor
    """
    from ..offline.job import Job
    from ..offline.monocular import run_monocular

    config = settings(recording, config_path, overrides, ignore_poses)
    job = Job.open("monocular", recording, description, config, out)
    with progress() as say:
        content = run_monocular(job, say)
    if as_json:
        click.echo(json.dumps(content, indent=2))
        return
    for reason, count in content["skipped"].items():
        click.echo(f"skipped {count}: {reason}")
    compared = (
        f"{content['judged']} compared with depth, floor IoU {content['iou']:.3f}"
        if content["judged"]
        else "no depth to compare with"
    )
    click.echo(f"{count_of(content['frames'], 'frame')}, {compared}: {job.folder.root}")


@click.command(name="calibrate-noise")
@click.argument("recording", type=PATH)
@description_option
@ignore_poses_option
@click.option("--out", type=PATH, help="TOML file to write; default NAME-noise.toml.")
@config_option
@set_option
@json_option
def calibrate_noise(
    recording: Path,
    description: Path | None,
    ignore_poses: bool,
    out: Path | None,
    config_path: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Estimate noise and bend of the depth sensor of RECORDING, and write them as settings.

    \b
    RECORDING shows a flat floor, or any static room with bare walls, best from 0.5 to 3 m. Every verb takes the
    file with --config. Noise comes from the scatter about the surfaces, bend from what is left of them over the
    picture; scale and tilt only where the recording has poses.
    Examples:
      surefoot calibrate-noise ~/floor.bag --out sensor.toml
      surefoot process ~/walk.bag --config sensor.toml
    """
    from ..offline.calibrate_noise import calibrate
    from ..recordings.without_poses import open_input

    config = settings(recording, config_path, overrides, ignore_poses)
    opened = open_input(recording, description, config.ignore_poses, config.reader)
    path = Path(f"{opened.info.name}-noise.toml") if out is None else out
    with progress() as say:
        found = calibrate(opened, config, say)
    found.write(path)
    if as_json:
        click.echo(json.dumps(found.content(), indent=2))
        return
    click.echo("\n".join([*found.lines(), f"settings: {path}"]))
