"""Range checks of configuration values."""

from __future__ import annotations

import math

from perception.primitives.errors import ConfigError

MOST_PX = 4096.0  # ours: side of a rendered image; software rendering takes seconds per image


def check_ranges(area: str, config: object, **ranges: tuple[float, float]) -> None:
    """Check that values, or all numbers of a tuple, are finite and within their range.

    Args:
        area: Part of the configuration, for the message.
        config: Object with the attributes.
        ranges: (least, most) by name; may be infinite.

    Raises:
        ConfigError: with the value and its range.
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
