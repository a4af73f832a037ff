"""The writer of Parquet files; DuckDB reads and writes them."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import duckdb
import numpy as np

from .schema import SCHEMA_VERSION, selection

Values = Mapping[str, np.ndarray | Sequence[Any]]
OWN = {"surefoot_schema": str(SCHEMA_VERSION)}


def connect(threads: int | None = None) -> duckdb.DuckDBPyConnection:
    """A database in memory that loads no extensions and prints nothing.

    Args:
        threads: None: all cores.
    """
    options: dict[str, Any] = {
        "autoinstall_known_extensions": False,
        "autoload_known_extensions": False,
    }
    if threads is not None:
        options["threads"] = threads
    database = duckdb.connect(":memory:", config=options)
    database.execute("SET enable_progress_bar = false")
    return database


def form(metadata: Mapping[str, str] = OWN) -> str:
    """The options of a COPY that writes Parquet."""
    pairs = ", ".join(f"{name}: {quoted(value)}" for name, value in metadata.items())
    return f"FORMAT parquet, COMPRESSION zstd, KV_METADATA {{{pairs}}}"


def quoted(text: object) -> str:
    """A text as SQL."""
    return "'" + str(text).replace("'", "''") + "'"


def file(path: str | Path) -> str:
    """A file to read as SQL; DuckDB takes a bare *, ? or [ of a path for a pattern, which other files fit too."""
    return quoted(re.sub(r"[*?[]", r"[\g<0>]", str(path)))


def write(database: duckdb.DuckDBPyConnection, table: str, values: Values, path: Path) -> None:
    """Write the rows of a table; the same rows give the same bytes on one thread.

    Args:
        database: Of `connect`.
        table: Name of the table in the schema.
        values: Columns by name, of equal length; NaN and None are NULL, lists and maps are JSON.
        path: The file; it is written in place.
    """
    copy(database, values, path, selection(table))


def copy(
    database: duckdb.DuckDBPyConnection,
    values: Values,
    path: Path,
    selected: str = "*",
    metadata: Mapping[str, str] = OWN,
) -> None:
    """Write columns of equal length as a Parquet file.

    Args:
        database: Of `connect`.
        values: Columns by name.
        path: The file; it is written in place.
        selected: What to select of the columns, in SQL.
        metadata: Of the file.

    Raises:
        OSError: It cannot be written.
    """
    database.register("given", {name: _array(column) for name, column in values.items()})
    try:
        database.execute(
            f"COPY (SELECT {selected} FROM given) TO {quoted(path)} ({form(metadata)})"
        )
    except duckdb.IOException as error:
        words = str(error)  # DuckDB gives no number, only the words of the system
        number = next((one for one in errno.errorcode if os.strerror(one) in words), errno.EIO)
        raise OSError(number, os.strerror(number), str(path)) from error
    finally:
        database.unregister("given")


def _array(column: np.ndarray | Sequence[Any]) -> np.ndarray:
    """An array that DuckDB reads; text and None stay objects."""
    if isinstance(column, np.ndarray):
        return column
    found = np.empty(len(column), dtype=object)
    found[:] = column
    return found
