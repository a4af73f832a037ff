"""Progress, one-line errors, exit codes and the browser of the command line.

Results go to standard output and everything else to standard error, so that `--json` prints one object.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import shutil
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import click

from perception.primitives import plugins
from perception.primitives.errors import InputError, OutputError, SurefootError

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit codes: done; the work failed; bad input; stopped by Ctrl-C."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
REFUSED = (*FULL, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG, errno.ELOOP)
"""Errors of the system that the user or the disk causes, not the program."""


class Progress:
    """One line on the terminal that is rewritten; a line every ten seconds if the output is a file."""

    SPARSE_S = 10.0

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._last_s = -math.inf
        self._width = 0

    def __call__(self, text: str) -> None:
        """Show the progress."""
        if self._live:
            click.echo("\r" + text.ljust(self._width), err=True, nl=False)
            self._width = len(text)
        elif time.monotonic() - self._last_s >= self.SPARSE_S:
            click.echo(text, err=True)
            self._last_s = time.monotonic()

    def notice(self, text: str) -> None:
        """Print a line at once; the progress line continues below it."""
        click.echo(("\r" if self._live else "") + text.ljust(self._width), err=True)

    def done(self) -> None:
        """End the line."""
        if self._live and self._width:
            click.echo(err=True)


_AFRESH = ("map", "merge", "panorama", "monocular")
"""Verbs without --resume; others say how to continue."""


class Verbs(click.Group):
    """Group of commands that prints every error as one line and exits with the code of its kind."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """The arguments; a usage error for one that is not UTF-8, which no report could quote."""
        for word in args:
            if word != word.encode(errors="replace").decode():
                raise click.UsageError(
                    f"{word!r} is not UTF-8; rename the file, or write the value in UTF-8"
                )
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a verb and translate its exceptions."""
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            ctx.exit(DONE)
        except KeyboardInterrupt:
            again = "; the same command starts afresh" if ctx.invoked_subcommand in _AFRESH else ""
            click.echo(f"\ninterrupted{again}", err=True)
            ctx.exit(INTERRUPTED)
        except SurefootError as error:
            click.echo(f"surefoot: {error}", err=True)
            ctx.exit(exit_code(error))
        except OSError as error:
            if error.errno not in REFUSED or ctx.params.get("debug"):
                self._unexpected(ctx, error)
            place = "" if error.filename is None else f"{error.filename}: "
            click.echo(f"surefoot: {place}{error.strerror}", err=True)
            ctx.exit(FAILED if error.errno in FULL else BAD_INPUT)
        except Exception as error:
            self._unexpected(ctx, error)

    def _unexpected(self, ctx: click.Context, error: Exception) -> NoReturn:
        """Print an unexpected error as one line, or with its traceback after --debug."""
        if ctx.params.get("debug"):
            traceback.print_exc()
        words = plugins.fault(error) or f"unexpected {type(error).__name__}: {error}"
        click.echo(
            f"surefoot: {words}; run again with --debug before the verb for the full traceback",
            err=True,
        )
        ctx.exit(FAILED)


def exit_code(error: SurefootError) -> int:
    """Exit code of an error: bad input if another argument, such as another --out, avoids it; else failed."""
    if isinstance(error, OutputError):
        cause = error.__cause__
        full = isinstance(cause, OSError) and cause.errno in FULL
        return FAILED if full else BAD_INPUT
    return BAD_INPUT if isinstance(error, InputError) else FAILED


@contextlib.contextmanager
def progress() -> Iterator[Progress]:
    """Context with a progress line; a notice says when kernels are compiled."""
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


def open_in_browser(page: Path | str) -> None:
    """Open a page where there is a desktop; quietly do nothing elsewhere."""
    if not sys.platform.startswith("linux"):
        click.launch(str(page))
        return
    opener = shutil.which("xdg-open")
    if opener and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        quiet = subprocess.DEVNULL
        subprocess.Popen([opener, str(page)], stdin=quiet, stdout=quiet, stderr=quiet)
