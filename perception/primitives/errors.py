"""What can go wrong, in words for the person who has to mend it.

Every message names the thing, its value, what was expected and what to do. The command line catches the
root once and shows one line; libraries raise, and never exit.
"""


class SurefootError(Exception):
    """Root of everything this project raises on purpose."""


class InputError(SurefootError):
    """What the user gave cannot be used: a path, a file, a name, a value."""


class ConfigError(InputError):
    """A configuration value is impossible or a key unknown."""


class RecordingError(InputError):
    """A recording as a whole cannot be read (a single bad frame is skipped and counted instead)."""


class OutputError(SurefootError):
    """Results cannot be written: disk full, folder read-only, path taken."""
