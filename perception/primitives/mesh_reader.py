"""Meshes and clouds from files, read by Open3D in a process of its own.

Damaged files can end the process that reads them or fill its memory. The process is started at the first file and reads
the next ones too; it ends with the program.
"""

from __future__ import annotations

import json
import os
import re
import resource
import select
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

MOST_SECONDS = 60.0  # ours: for one file
MOST_MEMORY_BYTES = 8 << 30  # address space of the process
MOST_WARNING_BYTES = 1 << 16  # ours: of Open3D's warnings about a file that are looked at
_DAMAGE = re.compile(rb"(unable to|could not) read [a-z ]+")  # in warnings of Open3D 0.20
MOST_EXTENT = 1e6  # ours: of a coordinate, in units of the file


@dataclass(frozen=True)
class Surface:
    """Content of a file.

    Args:
        vertices: (n, 3) of a mesh, or points of a cloud, in units of the file.
        triangles: (m, 3) indices of vertices, counter-clockwise seen from outside; none of a cloud.
    """

    vertices: np.ndarray
    triangles: np.ndarray


class MeshError(ValueError):
    """A file without a usable surface; the message says what is wrong, without its name."""


def read(path: str | Path) -> Surface:
    """A mesh, or a cloud if the file holds no triangles.

    Raises:
        MeshError: The file is damaged, empty or too large, or its numbers are impossible.
        ImportError: Open3D cannot be loaded.
    """
    try:
        answer, vertices, triangles = _answer(path)
    except BrokenPipeError as error:
        _stop()
        raise MeshError("cannot be read: the process that reads meshes has ended") from error
    except BaseException:
        _stop()
        raise
    if "missing" in answer:
        _stop()
        raise ImportError(answer["missing"])
    if "fault" in answer:
        raise MeshError(answer["fault"])
    return Surface(
        np.frombuffer(vertices, np.float64).reshape(-1, 3).copy(),
        np.frombuffer(triangles, np.int64).reshape(-1, 3).copy(),
    )


_reader: subprocess.Popen[bytes] | None = None


def _answer(path: str | Path) -> tuple[dict[str, Any], bytes, bytes]:
    """What the process says of a file, and the content of its arrays."""
    global _reader
    if _reader is None or _reader.poll() is not None:
        _reader = subprocess.Popen(
            [sys.executable, "-P", __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
    asked, said = _reader.stdin, _reader.stdout
    assert asked is not None
    assert said is not None
    asked.write(json.dumps(str(Path(path).resolve())).encode() + b"\n")
    asked.flush()
    if not select.select([said], [], [], MOST_SECONDS)[0]:
        raise MeshError(f"takes more than {MOST_SECONDS:.0f} s to read; simplify the mesh")
    line = said.readline()
    if not line:
        raise MeshError("is damaged: Open3D crashes or takes too much memory when it reads it")
    answer = json.loads(line)
    sizes = (24 * answer.get(name, 0) for name in ("vertices", "triangles"))
    vertices, triangles = (said.read(size) for size in sizes)
    return answer, vertices, triangles


def _stop() -> None:
    global _reader
    if _reader is not None:
        _reader.kill()
        _reader.wait()
        _reader = None


def _serve() -> None:
    """The process: read the names of files, one per line, and write their content."""
    out = os.fdopen(os.dup(1), "wb")
    said = os.memfd_create("warnings")
    os.dup2(said, 1)  # Open3D prints warnings there
    try:
        import open3d
    except ImportError as error:
        out.write(json.dumps({"missing": str(error)}).encode() + b"\n")
        return
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY_BYTES, MOST_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for line in sys.stdin:
        found = _content(open3d, json.loads(line))
        # of a damaged file Open3D gives what comes before the damage, and a warning
        os.lseek(said, 0, os.SEEK_SET)
        damage = _DAMAGE.search(os.read(said, MOST_WARNING_BYTES))
        os.ftruncate(said, 0)
        os.lseek(said, 0, os.SEEK_SET)
        if damage is not None and not isinstance(found, str):
            found = f"is damaged or cut off ({damage.group().decode()}); restore the file or export it again"
        if isinstance(found, str):
            out.write(json.dumps({"fault": found}).encode() + b"\n")
        else:
            vertices, triangles = found
            sizes = {"vertices": len(vertices), "triangles": len(triangles)}
            out.write(json.dumps(sizes).encode() + b"\n")
            out.write(vertices.tobytes() + triangles.tobytes())
        out.flush()


def _content(open3d: Any, name: str) -> str | tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a file, or what is wrong with it."""
    try:
        mesh = open3d.io.read_triangle_mesh(name)
        points, triangles = mesh.vertices, np.asarray(mesh.triangles, dtype=np.int64)
        if not len(triangles):
            points = open3d.io.read_point_cloud(name).points
        vertices = np.asarray(points, dtype=np.float64)
    except Exception as error:  # Open3D raises many types
        return f"cannot be read by Open3D: {error}"
    if not len(vertices):
        return "contains neither triangles nor points that Open3D can read"
    if not np.isfinite(vertices).all():
        return "has vertices that are not finite; export it again"
    if np.abs(vertices).max() > MOST_EXTENT:
        return f"reaches {np.abs(vertices).max():.3g} units from its origin; {MOST_EXTENT:.0e} are the most"
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        return "has triangles of vertices that it lacks; export it again"
    return vertices, triangles


if __name__ == "__main__":
    _serve()
