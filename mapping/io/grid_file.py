"""The terrain map as one file: a zip of arrays that NumPy reads, for display or to resume from.

Every array is in world order, row 0 at the smallest y, so that `numpy.load` suffices to plot it. Updates of
a map that was saved and loaded give the same bits as those of the original.

Arrays: `format`; `settings` (the grid's configuration, JSON); `start`, `first`, `rest` and `latest_s`
(position and time of the grid); `log_odds`, `updated_s`, `moving`, `height_m`, `height_variance_m2`,
`raised`, `hanging`; and optionally `confidence`.

Source: ours.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives import safe_input
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.safe_input import UnreadableError

from ..grid.confidence import ConfidenceConfig, ConfidenceLayer
from ..grid.egocentric_grid import EgocentricGrid, GridConfig
from ..grid.evidence import EvidenceConfig
from .atomic_write import atomic_path

FORMAT = 3
PLACES = {"start": ((2,), "f"), "first": ((2,), "i"), "rest": ((2,), "f"), "latest_s": ((), "f")}
LAYERS = {
    "log_odds": "f",
    "updated_s": "f",
    "moving": "b",
    "height_m": "f",
    "height_variance_m2": "f",
    "raised": "b",
    "hanging": "b",
}


def save(path: str | Path, grid: EgocentricGrid, confidence: ConfidenceLayer | None = None) -> Path:
    """Write the map atomically and return the path.

    Args:
        path: File name that ends in .npz.
        grid: The map.
        confidence: Its confidence layer, for the same file.

    Raises:
        InputError: The suffix is another one.
        OutputError: The folder cannot be written.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise InputError(f"terrain map {path}: expected a name that ends in .npz")
    settings = asdict(grid.config)
    content = grid.snapshot()
    if confidence is not None:
        settings["confidence"] = asdict(confidence.config)
        content["confidence"] = confidence.values
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            format=np.array(FORMAT),
            settings=np.array(json.dumps(settings)),
            **content,  # type: ignore[arg-type]  # names of arrays, not of the other argument
        )
    return path


def load(path: str | Path) -> tuple[EgocentricGrid, ConfidenceLayer | None]:
    """Read a map; every value in the file is checked.

    Raises:
        InputError: The file is absent, truncated, no terrain map, or has impossible values.
    """
    content = _arrays(path)
    settings, config = _settings(path, content)
    for name, (shape, kind) in PLACES.items():
        _expect(path, content, name, shape, kind)
    n = config.cells
    for name, kind in LAYERS.items():
        _expect(path, content, name, (n, n), kind)
    _check_values(path, content, config)
    grid = EgocentricGrid.restored(config, content)
    if "confidence" not in content:
        return grid, None
    _expect(path, content, "confidence", (n, n), "f")
    values = content["confidence"]
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise InputError(f"terrain map {path}: confidence outside [0, 1]; the file is damaged")
    try:
        layer = ConfidenceLayer(grid, ConfidenceConfig(**settings["confidence"]))
    except (KeyError, TypeError, ConfigError) as error:
        raise InputError(
            f"terrain map {path}: settings of the confidence layer: {error}"
        ) from error
    layer.restore(values.astype(np.float32))
    return grid, layer


def _arrays(path: str | Path) -> dict[str, np.ndarray]:
    """All arrays of the file, with checksums verified and pickles refused."""
    try:
        return safe_input.arrays(path)
    except UnreadableError as error:
        raise InputError(f"terrain map {path} {error}; save it again") from error


def _settings(
    path: str | Path, content: Mapping[str, np.ndarray]
) -> tuple[dict[str, Any], GridConfig]:
    _expect(path, content, "format", (), "i")
    if int(content["format"]) != FORMAT:
        raise InputError(
            f"terrain map {path}: format {int(content['format'])}, this version reads {FORMAT}"
        )
    _expect(path, content, "settings", (), "U")
    try:
        settings = safe_input.json(str(content["settings"]))
        values = {k: v for k, v in settings.items() if k != "confidence"}
        values["evidence"] = EvidenceConfig(**values["evidence"])
        return settings, GridConfig(**values)
    except (ValueError, KeyError, TypeError, AttributeError, ConfigError) as error:
        raise InputError(f"terrain map {path}: its settings cannot be used: {error}") from error


def _expect(
    path: str | Path,
    content: Mapping[str, np.ndarray],
    name: str,
    shape: tuple[int, ...],
    kind: str,
) -> None:
    """One array, its shape, and its kind: f(loat), i(nteger), b(ool), U (text)."""
    if name not in content:
        raise InputError(f"terrain map {path}: no array {name!r}; is it a terrain map?")
    found = content[name]
    if found.shape != shape or found.dtype.kind != kind:
        raise InputError(
            f"terrain map {path}: {name!r} is {found.dtype} of shape {found.shape}, expected kind "
            f"{kind!r} of shape {shape}; the file is damaged"
        )


def _check_values(path: str | Path, content: Mapping[str, np.ndarray], config: GridConfig) -> None:
    odds, seen = content["log_odds"], np.isfinite(content["log_odds"])
    limit = max(config.evidence.limit, 10.0)  # first observations may exceed the limit
    half = config.cell_m / 2 * (1 + 1e-9)
    variance = content["height_variance_m2"]
    measured = np.isfinite(content["height_m"])
    checks = {
        "start, rest": np.isfinite(content["start"]).all() and np.isfinite(content["rest"]).all(),
        "rest": config.literal or bool((np.abs(content["rest"]) <= half).all()),
        "latest_s": not np.isnan(content["latest_s"]),
        "log_odds": bool((np.abs(odds[seen]) <= limit).all() and (odds[~seen] == np.inf).all()),
        "updated_s": bool(
            np.isfinite(content["updated_s"]).all() and (content["updated_s"][~seen] == 0.0).all()
        ),
        "moving": not content["moving"][~seen].any(),
        "height_m": not np.isinf(content["height_m"]).any() and not (measured & ~seen).any(),
        "hanging": not (content["hanging"] & ~measured).any(),
        "height_variance_m2": bool(
            (np.isfinite(variance) == measured).all() and (variance[measured] > 0.0).all()
        ),
    }
    wrong = [name for name, right in checks.items() if not right]
    if wrong:
        raise InputError(
            f"terrain map {path}: {', '.join(wrong)} hold impossible values; the file is damaged"
        )
