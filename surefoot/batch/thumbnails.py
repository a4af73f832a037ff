"""Small pictures of runs, kept in the folder of the batch."""

from __future__ import annotations

from pathlib import Path

import cv2

from perception.primitives import safe_input
from perception.primitives.errors import RecordingError
from perception.primitives.safe_input import UnreadableError

from ..results.run_folder import RunFolder

FOLDER = "thumbnails"
WIDTH, HEIGHT = 96, 72  # px
QUALITY = 60
PICTURES = ("panorama_obstacles.png", "map.pgm")  # of runs without camera pictures


def thumbnail(batch: RunFolder, name: str, run: Path) -> bytes:
    """The picture of a run as WebP; empty if it has none."""
    kept = batch.path(f"{FOLDER}/{name}.webp")
    if not kept.is_file():
        batch.write_bytes(f"{FOLDER}/{name}.webp", _drawn(RunFolder(run)))
    return kept.read_bytes()


def _drawn(run: RunFolder) -> bytes:
    """The middle one of the camera pictures, else the panorama or the map, as WebP."""
    for name in (*_views(run), *PICTURES):
        try:
            image = safe_input.picture(safe_input.data(run.path(name)), cv2.IMREAD_COLOR)
        except UnreadableError:
            continue
        scale = min(WIDTH / image.shape[1], HEIGHT / image.shape[0])
        size = (max(1, round(scale * image.shape[1])), max(1, round(scale * image.shape[0])))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        return bytes(cv2.imencode(".webp", small, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1])
    return b""


def _views(run: RunFolder) -> list[str]:
    try:
        views = run.read_json("views.json") or []
    except RecordingError:
        return []
    coloured = [one for one in views if one["name"] == "colour"] or views
    return [coloured[len(coloured) // 2]["file"]] if coloured else []
