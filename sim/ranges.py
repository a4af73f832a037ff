"""Ranges of configuration values: what no robot and no room has is refused when the configuration is made."""

from __future__ import annotations

import math

from perception.primitives.errors import ConfigError


def check_ranges(area: str, config: object, **ranges: tuple[float, float]) -> None:
    """Every named value, or each number of it, is finite and neither below the least nor above the most.

    Args:
        area: Part of the configuration, for the message.
        config: Whose attributes are meant.
        ranges: (least, most) by name; infinite where there is no end.

    Raises:
        ConfigError: naming value and range.
    """
    for name, (least, most) in ranges.items():
        value = getattr(config, name)
        for number in value if isinstance(value, tuple) else (value,):
            if not math.isfinite(number):
                wanted = "be finite"
            elif number < least:
                wanted = "not be negative" if least == 0.0 else f"be at least {least:g}"
            elif number > most:
                wanted = f"be at most {most:g}"
            else:
                continue
            raise ConfigError(f"{area}: {name}={value} must {wanted}")
