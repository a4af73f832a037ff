"""Pictures that a run keeps as files: the stages of the monocular cycle, and panoramic scans."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from perception.primitives import safe_input
from perception.primitives.safe_input import UnreadableError

from ...results.moment import Moment
from ...results.run_folder import RunFolder
from .gathering import Shot, Strip

WIDTH_PX = 720  # ours: stages are eight pictures in one
PANORAMA_PX = 1100  # ours: it has words in it
QUALITY = 60
MOST = 240  # ours: more are thinned before they are encoded
PLAIN = ("colour", "tof", "stereo", "depth")  # views that the moments have too


def extra_strips(run: RunFolder, moments: Sequence[Moment]) -> list[Strip]:
    """The pictures by what they show, at the moment from which they hold."""
    strips: dict[str, Strip] = {}
    stamps = np.array([moment.stamp_s for moment in moments])
    for view in run.read_json("views.json") or []:
        name = str(view["name"]).split(",")[0]
        if name in PLAIN or not run.has(view["file"]):
            continue
        strip = strips.setdefault(name, Strip(name.capitalize(), wide=True))
        moment = int(np.searchsorted(stamps, float(view["stamp"]) - 1e-6))
        label = f"{view['name']}, at {float(view['stamp']) - stamps[0]:.1f} s"
        _add(strip, min(moment, len(moments) - 1), run.path(view["file"]), label)
    if run.has("panorama_obstacles.png"):
        strip = strips.setdefault("panorama", Strip("Panorama of all views", wide=True))
        picture = run.path("panorama_obstacles.png")
        _add(strip, 0, picture, "range, with obstacles and gaps", PANORAMA_PX)
    stages = run.stages()
    every = max(1, -(-len(stages) // MOST))
    for k in range(0, min(len(stages), len(moments)), every):
        strip = strips.setdefault("stages", Strip("Stages of the monocular cycle", wide=True))
        number, picture = stages[k]
        label = f"frame {number}: A, B images; C floor; D edges; E flow; F least flow; G prediction; H result"
        _add(strip, k, picture, label)
    return [strip for strip in strips.values() if strip.shots]


def _add(strip: Strip, moment: int, path: Path, label: str, widest_px: int = WIDTH_PX) -> None:
    """The picture at the width of the page, with its caption; nothing if it cannot be decoded."""
    try:
        picture = safe_input.picture(safe_input.data(path), cv2.IMREAD_COLOR)
    except UnreadableError:
        return
    if picture.shape[1] > widest_px:
        height = max(1, round(picture.shape[0] * widest_px / picture.shape[1]))
        picture = cv2.resize(picture, (widest_px, height), interpolation=cv2.INTER_AREA)
    small = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1]
    strip.shots.append(Shot(moment, small.tobytes()))
    strip.labels.append(label)
