"""Tables that are written row by row during a run, so that memory does not grow with its length.

A stream writes to a temporary file and renames it when it is closed. It can be kept in a checkpoint; the
restored stream truncates the file to the row of the checkpoint and continues there.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mapping.io.atomic_write import PART
from perception.primitives.errors import InputError

from .formats import TUM_HEADER, cell, plain_json, refuse, tum_line
from .run_folder import RunFolder


class RowStream:
    """A CSV table, written row by row; floats without loss, None and NaN as empty cells."""

    def __init__(self, folder: RunFolder, name: str, header: Sequence[str]) -> None:
        """Open the temporary file and write the header.

        Args:
            folder: Run folder.
            name: File name, also in a folder of the run folder.
            header: Names of the columns.
        """
        self._folder = folder
        self._name = name
        self._columns = len(header)
        self._file: Any = None
        self.rows = 0
        self._open("wb")
        self._put(",".join(header) + "\n")

    @property
    def _place(self) -> Path:
        return self._folder.path(self._name)

    @property
    def _part(self) -> Path:
        return self._folder.path(f"{PART}{self._name}")

    def append(self, row: Sequence[object]) -> None:
        """Write one row.

        Raises:
            OutputError: The disk is full.
        """
        if len(row) != self._columns:
            raise ValueError(f"{self._place.name}: {len(row)} cells under {self._columns} columns")
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow([cell(value) for value in row])
        self._put(text.getvalue())
        self.rows += 1

    def close(self, keep_empty: bool = True) -> None:
        """Rename the table to its final name; a table without rows is deleted unless keep_empty."""
        self._file.close()
        if self.rows or keep_empty:
            self._place.parent.mkdir(exist_ok=True)
            os.replace(self._part, self._place)
        else:
            self._part.unlink()
        if self._part.parent != self._folder.root:
            with contextlib.suppress(OSError):  # other tables are still open
                self._part.parent.rmdir()

    def __getstate__(self) -> dict[str, Any]:
        self._file.flush()
        return {**self.__dict__, "_file": self._file.tell()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        length = state["_file"]
        self._open("r+b")
        if self._file.seek(0, os.SEEK_END) < length:
            raise InputError(f"its table {self._name} has lost its last rows")
        self._file.truncate(length)
        self._file.seek(length)

    def _open(self, mode: str) -> None:
        try:
            self._part.parent.mkdir(exist_ok=True)
            self._file = self._part.open(mode)
        except OSError as error:
            refuse(error, self._part)

    def _put(self, text: str) -> None:
        try:
            self._file.write(text.encode())
        except OSError as error:
            refuse(error, self._part)


class PoseStream(RowStream):
    """A trajectory as TUM text, written pose by pose."""

    def __init__(self, folder: RunFolder, name: str) -> None:
        """Open the temporary file and write the header."""
        super().__init__(folder, name, (TUM_HEADER,))

    def append(self, row: Sequence[Any]) -> None:
        """Write one upright pose: stamp in s, x, y, z in m, yaw in rad."""
        self._put(tum_line(*row))
        self.rows += 1


class JsonStream(RowStream):
    """A list in a JSON file, written as one object per line until it is closed."""

    def __init__(self, folder: RunFolder, name: str) -> None:
        """Open the temporary file."""
        super().__init__(folder, name, ())

    def append(self, row: Any) -> None:
        """Write one object."""
        self._put(json.dumps(plain_json(row), allow_nan=False) + "\n")
        self.rows += 1

    def drain(self) -> Iterator[Any]:
        """Close it and return its objects one by one; the file is deleted after the last."""
        self._file.close()
        try:
            with self._part.open("rb") as lines:
                lines.readline()  # the empty header
                yield from map(json.loads, lines)
            self._part.unlink()
        except OSError as error:
            refuse(error, self._part)

    def close_into(self, key: str, rest: dict[str, Any]) -> None:
        """Write the final file: the list under `key`, followed by the other values."""
        self._file.close()
        whole = self._part.with_name(f"{self._part.name}-whole")
        try:
            with self._part.open("rb") as lines, whole.open("wb") as file:
                lines.readline()  # the empty header
                file.write(b'{"' + key.encode() + b'": [\n')
                for number, line in enumerate(lines):
                    file.write((b",\n" if number else b"") + line.rstrip(b"\n"))
                file.write(b"\n]")
                for name, value in rest.items():
                    file.write(f',\n"{name}": '.encode())
                    file.write(json.dumps(plain_json(value), allow_nan=False).encode())
                file.write(b"}\n")
            os.replace(whole, self._place)
            self._part.unlink()
        except OSError as error:
            refuse(error, self._place)
