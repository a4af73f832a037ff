"""Text formats of run folders: CSV cells, JSON values, TUM lines, and the message for a failed write."""

from __future__ import annotations

import errno
import math
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from perception.primitives import safe_input
from perception.primitives.errors import OutputError
from perception.primitives.safe_input import UnreadableError

from . import run_json

TUM_HEADER = "# stamp tx ty tz qx qy qz qw"


def cell(value: object) -> str:
    """A value as a CSV cell; floats are written without loss, None and NaN as an empty cell."""
    if value is None:
        return ""
    if isinstance(value, (bool, np.bool_)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return "" if math.isnan(value) else repr(float(value))
    return str(value)


def plain_json(value: Any) -> Any:
    """Values of standard JSON from Python and NumPy values; NaN and infinity become None."""
    if isinstance(value, dict):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_json(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain_json(value.tolist())
    if isinstance(value, np.generic):
        return plain_json(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def parse_json_lines(path: Path, shape: Any) -> list[Any]:
    """The objects of an unfinished `JsonStream`, one per line, up to the first that is not whole or of another shape."""
    found = []
    try:
        for line in safe_input.data(path).splitlines()[1:]:
            one = safe_input.json(line)
            run_json.check(one, shape)
            found.append(one)
    except UnreadableError:
        pass
    return found


def tum_line(stamp_s: float, x: float, y: float, z: float, yaw: float) -> str:
    """An upright pose as a line of TUM text."""
    numbers = (stamp_s, x, y, z, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return " ".join(repr(float(number)) for number in numbers) + "\n"


def refuse(error: OSError, path: Path) -> NoReturn:
    """Raise an OutputError that says in one line why nothing can be written."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        reason = "the disk is full; free some space or choose another --out"
    elif error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        reason = "the folder is read-only for you; choose another --out or change its permissions"
    elif error.errno == errno.ENOTDIR:
        reason = "a part of its path is a file; choose another --out"
    else:
        reason = f"{error.strerror or error}; choose another --out"
    raise OutputError(f"cannot write into {error.filename or path}: {reason}") from error
