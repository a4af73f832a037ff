"""The verb that lists the robots which can walk in the simulation."""

from __future__ import annotations

import json
from typing import Any

import click

from .options import json_option


@click.command()
@json_option
def robots(as_json: bool) -> None:
    """List the robots for `simulate --robot`: size, cameras, gaze, licence, and whether their files are installed.

    \b
    Examples:
      surefoot robots
      surefoot simulate home --robot g1
    """
    from perception.primitives.robot_model import DARWIN_OP
    from sim.robots import catalogue, installed
    from sim.robots.description import SENSORS

    listed: list[dict[str, Any]] = [
        {
            "name": catalogue.OWN,
            "title": "our own, the size of a DARwIn-OP",
            "height_m": DARWIN_OP.height_m,
            "radius_m": DARWIN_OP.radius_m,
            "cameras": list(SENSORS),
            "gaze": ["pan", "tilt"],
            "licence": "Apache-2.0",
            "origin": "this project",
            "package": "",
            "installed": True,
        }
    ]
    for name in catalogue.names():
        robot = catalogue.load(name)
        listed.append(
            {
                "name": name,
                "title": robot.title,
                "height_m": robot.model.height_m,
                "radius_m": robot.model.radius_m,
                "cameras": [sensor for sensor, _ in robot.sensors],
                "gaze": [robot.gaze.pan, robot.gaze.tilt],
                "licence": robot.licence,
                "origin": robot.origin,
                "package": robot.package,
                "installed": installed.folder(robot.package) is not None,
            }
        )
    if as_json:
        click.echo(json.dumps(listed, indent=2))
        return
    for one in listed:
        there = "installed" if one["installed"] else f"not installed: {installed.EXTRA}"
        click.echo(
            f"{one['name']:<9} {one['title']}, {one['height_m']:.2f} m, cameras {', '.join(one['cameras'])}, gaze by "
            f"{' and '.join(one['gaze'])}, {one['licence']}, {there}"
        )
