"""How the command line speaks and fails: progress, one-line errors, exit codes.

Results go to the output, everything else to the error stream, so that what `--json` prints stays one object.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
import traceback
from collections.abc import Iterator
from typing import Any

import click

from perception.primitives.errors import InputError, SurefootError

DONE, FAILED, BAD_INPUT = 0, 1, 2
"""Exit codes: done; the work failed; the input was bad."""


class Progress:
    """One line on the terminal that rewrites itself; sparse lines where the output is a file."""

    SPARSE_S = 10.0

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._told_s = -math.inf
        self._width = 0

    def __call__(self, text: str) -> None:
        """Show where the work is."""
        if self._live:
            click.echo("\r" + text.ljust(self._width), err=True, nl=False)
            self._width = len(text)
        elif time.monotonic() - self._told_s >= self.SPARSE_S:
            click.echo(text, err=True)
            self._told_s = time.monotonic()

    def notice(self, text: str) -> None:
        """Print a line at once; the progress line continues below it."""
        click.echo(("\r" if self._live else "") + text.ljust(self._width), err=True)

    def done(self) -> None:
        """Leave the line behind."""
        if self._live and self._width:
            click.echo(err=True)


class Verbs(click.Group):
    """All errors come out here, as one line, with the exit code that tells whose turn it is."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a verb and translate what it raises."""
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            ctx.exit(DONE)
        except KeyboardInterrupt:
            click.echo("\nstopped; what was complete is kept", err=True)
            ctx.exit(FAILED)
        except SurefootError as error:
            click.echo(f"surefoot: {error}", err=True)
            ctx.exit(BAD_INPUT if isinstance(error, InputError) else FAILED)
        except Exception as error:
            if ctx.params.get("debug"):
                traceback.print_exc()
            click.echo(
                f"surefoot: unexpected {type(error).__name__}: {error}; "
                "run again with --debug before the verb for the full trace",
                err=True,
            )
            ctx.exit(FAILED)


@contextlib.contextmanager
def progress() -> Iterator[Progress]:
    """A progress line for the length of a block; a notice says when kernels are compiled."""
    from numba.core import event  # slow to load

    class Notice(event.Listener):
        given = False

        def on_start(self, event: Any) -> None:
            if not self.given:
                say.notice("compiling kernels for this machine: once, about a minute")
            self.given = True

        def on_end(self, event: Any) -> None:
            pass

    say = Progress()
    try:
        with event.install_listener("numba:compile", Notice()):
            yield say
    finally:
        say.done()
