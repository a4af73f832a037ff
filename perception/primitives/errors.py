"""Errors that the project raises, with messages for the user.

Every message has the name, the value, what was expected, and what to do. The command line catches the root class and
prints one line; libraries raise and never exit.
"""


class SurefootError(Exception):
    """Root of all errors of this project."""


class InputError(SurefootError):
    """Unusable input: a path, a file, a name, a value."""


class ConfigError(InputError):
    """Invalid configuration value, or unknown key."""


class RecordingError(InputError):
    """Unreadable recording; a single bad frame is skipped and counted instead."""


class OutputError(SurefootError):
    """Results cannot be written: disk full, folder read-only, path in use."""
