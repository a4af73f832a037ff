"""Calls of a user's planner or gaze policy: what it cannot take, and what no body can execute, is named."""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Real
from typing import Any

from perception.primitives.errors import InputError

from .commands import GazeCommand, WalkCommand


def call(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """What a function of a plug-in returns.

    Args:
        name: Kind and name of the plug-in.
        function: Its class or one of its methods.
        arguments: What the protocol passes.

    Raises:
        InputError: The function does not take these arguments. Errors inside it pass through.
    """
    try:
        return function(*arguments)
    except TypeError as error:
        if error.__traceback__ is None or error.__traceback__.tb_next is not None:
            raise
        raise InputError(f"{name}: {error}; see the protocol") from error


def check_finite(name: str, command: WalkCommand | GazeCommand) -> None:
    """Refuse a command with a value that is no finite number.

    Args:
        name: Kind and name of the plug-in, and its method.
        command: What it returned.

    Raises:
        InputError: Names the value.
    """
    for key, value in vars(command).items():
        if not (isinstance(value, Real) and math.isfinite(value)):
            kind = type(command).__name__
            raise InputError(
                f"{name} returned a {kind} with {key}={value!r}; expected a finite number"
            )
