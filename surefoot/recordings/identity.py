"""What tells one recording from another: names, sizes, and the beginning and end of files."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from perception.primitives.errors import RecordingError

from .open import MCAP_NAME

PIECE = 1 << 16  # bytes read at the beginning and the end of a file
MOST_FILES = 50  # of a folder whose content is read, evenly spaced


def identity(path: Path, description: Path | None = None, apart_from: Path | None = None) -> str:
    """A digest of a recording, the same wherever it lies.

    Args:
        path: File or folder.
        description: A recording.toml kept elsewhere.
        apart_from: A folder inside it that does not belong to it.

    Raises:
        RecordingError: It cannot be read.
    """
    digest = hashlib.sha256()
    try:
        single = path / MCAP_NAME if (path / MCAP_NAME).is_file() else path
        files = [single] if single.is_file() else _files(path, apart_from)
        for file in files:
            name = file.name if single.is_file() else file.relative_to(path).as_posix()
            digest.update(os.fsencode(f"{name}\0{file.stat().st_size}\0"))
        read = files[:: max(1, -(-len(files) // MOST_FILES))]
        for file in read if description is None else [*read, description]:
            with file.open("rb") as content:
                digest.update(content.read(PIECE))
                content.seek(max(PIECE, file.stat().st_size - PIECE))
                digest.update(content.read(PIECE))
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    return digest.hexdigest()


def _files(folder: Path, apart_from: Path | None) -> list[Path]:
    """All regular files below a folder, sorted."""
    apart = None if apart_from is None else apart_from.resolve()
    found = (file for file in folder.rglob("*") if file.is_file())
    return sorted(file for file in found if apart is None or apart not in file.resolve().parents)
