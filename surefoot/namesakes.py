"""Refuses to start where another folder or module hides one of Surefoot's packages.

Python looks first in the folder of a script and, with `python -m`, in the working folder. A user's own `planning/` or
`sim.py` there would be imported instead of ours. `surefoot/__init__.py` asks first of all, since any other import could
meet the wrong package.
"""

from __future__ import annotations

import importlib.util
import os
import sys

PACKAGES = ("perception", "mapping", "planning", "sim")


def fault() -> str:
    """One line about the first package that would not be ours; "" if all are. Imports nothing."""
    ours = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    for name in PACKAGES:
        found = importlib.util.find_spec(name)
        if found is None:
            return f"surefoot: its package {name!r} is missing in {ours}; install surefoot again"
        place = [*(found.submodule_search_locations or []), str(found.origin)][0]
        if os.path.realpath(place) != os.path.realpath(os.path.join(ours, name)):
            return (
                f"surefoot: {place} hides surefoot's package {name!r}; rename it, or start in another folder (the command "
                "`surefoot` does not look into the working folder, `python -m surefoot` does)"
            )
    return ""


def refuse() -> None:
    """Stop if a package is hidden: `surefoot` with one line and exit code 2, a user's program with an ImportError.

    Raises:
        ImportError: A program imports surefoot.
        SystemExit: `surefoot` or `python -m surefoot` starts.
    """
    message = fault()
    if not message:
        return
    program = sys.argv[0] if sys.argv else ""
    if program == "-m" or os.path.basename(program) in ("surefoot", "surefoot.exe"):
        print(message, file=sys.stderr)
        raise SystemExit(2)
    raise ImportError(message)
