"""Where the models' files are: in an installed distribution, or beside a description.

The wheels of cmeel put their data below `cmeel.prefix/share` of the site's packages; others into the package itself.
"""

from __future__ import annotations

import os
from importlib import metadata
from pathlib import Path

from perception.primitives.errors import InputError

EXTRA = "pip install 'surefoot[robots]'"
SHARES = ("cmeel.prefix/share/{name}", "../../../share/{name}", "{module}")


def folder(distribution: str) -> Path | None:
    """The folder with the data of a distribution; None if it is not installed."""
    try:
        found = metadata.distribution(distribution)
    except metadata.PackageNotFoundError:
        return None
    for share in SHARES:
        place = share.format(name=distribution, module=distribution.replace("-", "_"))
        path = Path(str(found.locate_file(place)))
        if path.is_dir():
            return path
    return None


def version(distribution: str) -> str | None:
    """Version of a distribution; None if it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def file(distribution: str, name: str, wanted_by: str) -> Path:
    """A file of a distribution.

    Args:
        distribution: Such as "example-robot-data".
        name: Path of the file below the folder of its data.
        wanted_by: Who asks, for the message.

    Raises:
        InputError: It is not installed, or has no such file.
    """
    place = folder(distribution)
    if place is None:
        raise InputError(
            f"{wanted_by} needs the package {distribution}, which is not installed; run: {EXTRA}"
        )
    path = place / name
    if not os.path.isfile(path):  # also for an impossible name
        raise InputError(
            f"{wanted_by}: {distribution} {version(distribution)} has no file {name}; looked in {place}"
        )
    return path
