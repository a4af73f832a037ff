"""Questions in SQL to the tables of one run or of thousands, by DuckDB: read only, and no other file can be opened."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb

from perception.primitives.errors import InputError

from . import parquet
from .collection import Say, Source, opened, relation
from .examples import EXAMPLES
from .schema import TABLES, describe


@dataclass(frozen=True)
class Answer:
    """Names of the columns, and rows."""

    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]]

    def column(self, name: str) -> list[Any]:
        """The values of a column.

        Raises:
            InputError: There is none of this name.
        """
        if name not in self.columns:
            raise InputError(f"the answer has no column {name!r}; it has {', '.join(self.columns)}")
        number = self.columns.index(name)
        return [row[number] for row in self.rows]


class Asker:
    """Answers questions to the tables, each of them a view named as in the schema."""

    def __init__(self, sources: Sequence[tuple[str, Source]]) -> None:
        """Make the views, and lock the database.

        Args:
            sources: Name to put before the names of the runs ("" for none), and source.
        """
        self._database = parquet.connect()
        for table in TABLES:
            self._database.execute(f'CREATE VIEW "{table}" AS {relation(table, sources)}')
        folders = [folder for _, source in sources for folder in source.folders]
        allowed = ", ".join(parquet.quoted(f"{folder}/") for folder in folders)
        self._database.execute(f"SET allowed_directories = [{allowed}]")
        self._database.execute("SET enable_external_access = false")
        self._database.execute("SET lock_configuration = true")

    def ask(self, question: str, values: Sequence[Any] = ()) -> Answer:
        """Answer a question.

        Args:
            question: One SELECT in DuckDB's SQL, or the name of an example.
            values: For its parameters `?`.

        Raises:
            InputError: The question is not one SELECT, or is wrong; the message lists the tables.
        """
        sql = EXAMPLES[question].sql if question in EXAMPLES else question
        try:
            statements = self._database.extract_statements(sql)
            if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
                raise InputError("a question is one SELECT; the tables cannot be changed")
            found = self._database.execute(sql, list(values))
            columns = tuple(str(one[0]) for one in found.description or ())
            return Answer(columns, found.fetchall())
        except duckdb.Error as error:
            raise InputError(
                f"{error}\ntables and columns:\n{describe()}\n"
                f"or the name of an example: {', '.join(EXAMPLES)}"
            ) from error

    def close(self) -> None:
        """Close the database."""
        self._database.close()


@contextlib.contextmanager
def asker(places: Sequence[Path], say: Say) -> Iterator[Asker]:
    """What answers questions to the runs of some places.

    Args:
        places: Run folders, and folders with runs at any depth. With several places, names of runs begin with the
            place.
        say: What was left out, and progress.

    Raises:
        InputError: A place has no runs with tables.
    """
    with contextlib.ExitStack() as stack:
        sources = [
            (str(place) if len(places) > 1 else "", stack.enter_context(opened(place, say)))
            for place in dict.fromkeys(places)
        ]
        found = Asker(sources)
        stack.callback(found.close)
        yield found
