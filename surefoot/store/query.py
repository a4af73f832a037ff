"""Questions in SQL to the tables of one run or of thousands, by DuckDB: read only, and no other file can be opened."""

from __future__ import annotations

import contextlib
import difflib
import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb

from perception.primitives.errors import InputError

from ..progress import Say
from . import parquet
from .collection import Source, opened, relation
from .examples import EXAMPLES
from .schema import TABLES, describe

MOST_ROWS = 1_000_000  # ours: of an answer; they are held in memory, about 1 GB with ten columns
LONGEST_S = 60.0  # ours: of an answer
MEMORY = "2GB"  # ours: of the database


@dataclass(frozen=True)
class Answer:
    """Names of the columns, each another, and rows."""

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
        names = [
            name(f"{folder}/") for folder in folders for name in (parquet.quoted, parquet.file)
        ]
        allowed = ", ".join(names)  # a pattern must be allowed as well as the file that it names
        self._database.execute(f"SET allowed_directories = [{allowed}]")
        self._database.execute(f"SET memory_limit = '{MEMORY}'")
        self._database.execute("SET temp_directory = ''")  # nothing is written
        self._database.execute("SET enable_external_access = false")
        self._database.execute("SET lock_configuration = true")

    def ask(
        self, question: str, values: Sequence[Any] = (), longest_s: float = LONGEST_S
    ) -> Answer:
        """Answer a question.

        Args:
            question: One SELECT in DuckDB's SQL, or the name of an example.
            values: For its parameters `?`.
            longest_s: Longest time for the answer.

        Raises:
            InputError: The question is not one SELECT, or is wrong (the message lists the tables), or asks for too much,
                or takes too long.
        """
        if question.replace("-", "_").isidentifier() and question not in EXAMPLES:  # SQL has blanks
            near = difflib.get_close_matches(question, EXAMPLES, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"known are: {', '.join(EXAMPLES)}"
            raise InputError(f"query {question!r} is unknown; {hint}")
        sql = EXAMPLES[question].sql if question in EXAMPLES else question
        try:
            statements = self._database.extract_statements(sql)
            if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
                raise InputError("a question is one SELECT; the tables cannot be changed")
            answer = self._interruptible(sql, values, longest_s)
        except (duckdb.OutOfMemoryException, MemoryError) as error:
            raise InputError(
                f"the question needs more than {MEMORY} of memory; add LIMIT, choose fewer columns, or ask fewer runs"
            ) from error
        except duckdb.Error as error:
            raise InputError(
                f"{error}\ntables and columns:\n{describe()}\n"
                f"or the name of an example: {', '.join(EXAMPLES)}"
            ) from error
        if len(answer.rows) > MOST_ROWS:
            raise InputError(
                f"the answer has more than {MOST_ROWS} rows; add LIMIT, or ask for sums and means (GROUP BY)"
            )
        return answer

    def _interruptible(self, sql: str, values: Sequence[Any], longest_s: float) -> Answer:
        """Execute in a thread: Ctrl-C does not reach Python inside of DuckDB."""
        with ThreadPoolExecutor(1) as pool:
            running = pool.submit(self._executed, sql, values)
            try:
                return running.result(longest_s)
            except TimeoutError as error:
                raise InputError(
                    f"the question has no answer after {longest_s:g} s; ask fewer runs, end its recursion (WITH "
                    "RECURSIVE), or allow more time: --timeout SECONDS"
                ) from error
            finally:
                while not running.done():
                    self._database.interrupt()
                    wait([running], 0.05)

    def _executed(self, sql: str, values: Sequence[Any]) -> Answer:
        found = self._database.execute(sql, list(values))
        columns = _numbered([str(one[0]) for one in found.description or ()])
        return Answer(columns, found.fetchmany(MOST_ROWS + 1))

    def close(self) -> None:
        """Close the database."""
        self._database.close()


def _numbered(names: Sequence[str]) -> tuple[str, ...]:
    """The names, each another: x, x_1, x_2, as DuckDB names them in a view."""
    found: list[str] = []
    for name in names:
        rest = (f"{name}_{number}" for number in itertools.count(1))
        found.append(next(one for one in itertools.chain([name], rest) if one not in found))
    return tuple(found)


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
