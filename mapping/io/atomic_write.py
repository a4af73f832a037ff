"""Atomic writing: a file is complete or absent.

The content goes into a temporary file beside the target, which then replaces the target in one step.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from perception.primitives.errors import OutputError

PART = ".part-"
"""Prefix of the names of unfinished files; a writer that is killed leaves some."""


@contextmanager
def atomic_path(target: str | Path) -> Iterator[Path]:
    """A temporary path with the target's suffix; it replaces the target if the block ends without error.

    Raises:
        OutputError: The folder is absent, read-only or full.
    """
    target = Path(target)
    try:
        handle, name = tempfile.mkstemp(
            suffix=target.suffix, prefix=f"{PART}{target.stem}-", dir=target.parent
        )
        os.close(handle)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror}; check the folder") from error
    temporary = Path(name)
    try:
        yield temporary
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.chmod(0o644)
        temporary.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror}; check the disk") from error
    finally:
        temporary.unlink(missing_ok=True)
