"""Tables that are written while the run goes on, so that a run of any length needs the same memory.

A stream writes beside its place and moves there when it is closed. It can be put into a checkpoint: taken out
again, it goes on at the row where the checkpoint was made, whatever was written after it.
"""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .run_folder import RunFolder, cell, plain_json, refuse


class RowStream:
    """A CSV table, row by row; None and NaN become empty cells, numbers keep every bit."""

    def __init__(self, folder: RunFolder, name: str, header: Sequence[str]) -> None:
        """Begin the table.

        Args:
            folder: Of the run.
            name: Of the file.
            header: Names of the columns.
        """
        self._place = folder.path(name)
        self._columns = len(header)
        self._part = self._place.with_name(f".part-{name}")
        self._file: Any = None
        self.rows = 0
        self._open("wb")
        self._put(",".join(header) + "\n")

    def append(self, row: Sequence[object]) -> None:
        """One more row.

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
        """Put the table in its place; one without rows only if it is to be kept."""
        self._file.close()
        if self.rows or keep_empty:
            os.replace(self._part, self._place)
        else:
            self._part.unlink()

    def __getstate__(self) -> dict[str, Any]:
        self._file.flush()
        return {**self.__dict__, "_file": self._file.tell()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        length = state["_file"]
        self._open("r+b")
        self._file.truncate(length)
        self._file.seek(length)

    def _open(self, mode: str) -> None:
        try:
            self._file = self._part.open(mode)
        except OSError as error:
            refuse(error, self._part)

    def _put(self, text: str) -> None:
        try:
            self._file.write(text.encode())
        except OSError as error:
            refuse(error, self._part)


class JsonStream(RowStream):
    """Objects for a list in a JSON file, one a line until the file is made."""

    def __init__(self, folder: RunFolder, name: str) -> None:
        """Begin the list."""
        super().__init__(folder, name, ())

    def append(self, row: Any) -> None:
        """One more object."""
        self._put(json.dumps(plain_json(row), allow_nan=False) + "\n")
        self.rows += 1

    def close_into(self, key: str, rest: dict[str, Any]) -> None:
        """Make the file: the list under a key, beside other values."""
        self._file.close()
        whole = self._part.with_name(f"{self._part.name}-whole")
        try:
            with self._part.open("rb") as lines, whole.open("wb") as file:
                lines.readline()  # of the columns, which are none
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


def remains(root: Path) -> list[Path]:
    """Unfinished tables of a run that was killed."""
    return sorted(root.glob(".part-*.csv")) + sorted(root.glob(".part-*.json*"))
