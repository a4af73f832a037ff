"""The page without scripts: what the run looked like, in a few pictures."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence

import cv2
import numpy as np

from ...results.moment import Moment
from ...results.run_folder import RunFolder
from .gathering import Strip

STILLS = 6  # ours: pictures of each sensor, evenly over the run


def still(run: RunFolder, moments: Sequence[Moment], strips: Sequence[Strip]) -> str:
    """HTML of the still page: the figure of the report from above, and pictures with their times."""
    parts = [
        "<h2>The run in pictures</h2>",
        '<p class="soft">The replay needs a browser that runs scripts and unpacks data (any since 2023). '
        "Without it, these are its pictures.</p>",
    ]
    for name, words in (("map", "from above"), ("surface", "surface")):
        if run.has(f"figures/{name}.svg"):
            data = run.path(f"figures/{name}.svg").read_bytes()
            parts.append(f'<figure class="plot">{_image("svg+xml", data, words)}</figure>')
            break
    if run.has("panorama_obstacles.png"):
        data = run.path("panorama_obstacles.png").read_bytes()
        parts.append(f'<figure class="plot">{_image("png", data, "panorama")}</figure>')
    parts.append('<div class="shots">')
    for strip in strips:
        step = max(1, len(strip.shots) // STILLS)
        for k in range(step // 2, len(strip.shots), step):
            shot = strip.shots[k]
            seconds = moments[shot.moment].stamp_s - moments[0].stamp_s
            caption = f"{strip.name}, {strip.labels[k] if strip.labels else f'{seconds:.1f} s'}"
            data, kind = shot.data, shot.kind
            if strip.step_m is not None:
                data, kind = _painted(data, strip.far_step), "jpeg"
            parts.append(
                f"<figure>{_image(kind, data, caption)}<figcaption>{html.escape(caption)}</figcaption></figure>"
            )
    return "\n".join([*parts, "</div>"])


def _painted(data: bytes, far_step: float) -> bytes:
    """A depth picture in colours: near is bright, missing is black."""
    levels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert levels is not None, "this page has encoded it"
    level = np.clip(255 * (1 - levels / far_step), 0, 255).astype(np.uint8)
    picture = cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS)
    picture[levels == 0] = 0
    return cv2.imencode(".jpg", picture)[1].tobytes()


def _image(kind: str, data: bytes, alt: str) -> str:
    content = base64.b64encode(data).decode("ascii")
    return f'<img alt="{html.escape(alt)}" src="data:image/{kind};base64,{content}">'
