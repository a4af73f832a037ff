"""Sections of the report page, as HTML: plots, camera views, panorama, tables."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Iterable, Sequence
from typing import Any

from ..results.run_folder import RunFolder
from .cards import Card
from .plots.style import Picture

MAX_STAGES = 20  # pictures of a monocular run; more make the page slow to load


def card_item(card: Card) -> str:
    """A card as a list item."""
    mark = {None: "", True: '<b class="good">✓ met</b> · ', False: '<b class="bad">✗ missed</b> · '}
    return (
        f'<li><span class="name">{html.escape(card.name)}</span>'
        f'<span class="value">{html.escape(card.value)}</span>'
        f'<span class="note">{mark[card.met]}{html.escape(card.note)}</span></li>'
    )


def plot_section(picture: Picture) -> str:
    """A plot with its heading and its sentence."""
    image = _image("svg+xml", picture.svg, picture.title)
    return _section(
        picture.identity, picture.title, picture.sentence, f'<figure class="plot">{image}</figure>'
    )


def views_section(run: RunFolder) -> str:
    """Camera views with a slider over time; empty without views. Without scripts all views are shown."""
    views = run.read_json("views.json") or []
    shots: dict[float, list[str]] = {}
    start = min((float(view["stamp"]) for view in views), default=math.inf)
    for view in views:
        if not run.has(view["file"]):
            continue
        kind = "png" if str(view["file"]).endswith(".png") else "jpeg"
        stamp = float(view["stamp"])
        caption = f"{view['name']}, {stamp - start:.1f} s"
        data = run.path(view["file"]).read_bytes()
        shots.setdefault(stamp, []).append(_captioned(kind, data, caption))
    sentence = "Camera views during the run; in depth images near is bright, and black pixels have no depth."
    labelled = [(f"{stamp - start:.1f} s", "".join(shots[stamp])) for stamp in sorted(shots)]
    return _slider("Camera views", sentence, labelled)


def stages_section(run: RunFolder) -> str:
    """Stages of the monocular cycle, at most `MAX_STAGES` frames; empty without pictures."""
    pictures = run.stages()
    step = max(1, math.ceil(len(pictures) / MAX_STAGES))
    labelled = [
        (f"frame {number}", _captioned("png", path.read_bytes(), f"frame {number}"))
        for number, path in pictures[::step]
    ]
    sentence = (
        "A and B: previous and current image. C: floor by colour. D: edges of the obstacles. E: optical flow. "
        "F: smallest flow of each obstacle. G: predicted positions of moving obstacles. H: result."
    )
    return _slider("Stages of the monocular cycle", sentence, labelled)


def sessions_section(run: RunFolder) -> str:
    """The sessions of a merge, what speaks for one place, and links to the other parts; empty without sessions."""
    content = run.read_json("sessions.json")
    if content is None:
        return ""
    sessions, parts, here = content["sessions"], content["parts"], content["part"]
    sentence = f"{len(sessions)} sessions make {len(parts)} maps; this is part {here}."
    if len(parts) == 1:
        sentence = f"{len(sessions)} sessions are merged into this map."
    elif len(parts) == len(sessions):
        sentence = f"Nothing was merged: each session stays a map of its own; this is part {here}."
    body = table(
        ("session", "name", "map", "frames", "part"),
        [[one[name] for name in ("session", "name", "map", "frames", "part")] for one in sessions],
    )
    body += table(
        ("sessions", "one place with probability", "merged", "aligned pairs of images"),
        [
            (
                " and ".join(map(str, pair["sessions"])),
                f"not compared: {pair.get('reason', 'unknown')}"
                if pair["probability"] is None
                else f"{pair['probability']:.3f}",
                "yes" if pair["merged"] else "no",
                pair["links"],
            )
            for pair in content["pairs"]
        ],
    )
    root = "" if here == 1 else "../"
    others = [(k, f"part-{k}/" if k > 1 else "") for k in range(1, len(parts) + 1) if k != here]
    links = [f'<a href="{root}{folder}report.html">part {k}</a>' for k, folder in others]
    body += f"<p>The other parts: {', '.join(links)}.</p>" if links else ""
    return _section("parts", "Sessions", sentence, body)


def panorama_section(run: RunFolder) -> str:
    """Range panorama and the table of its obstacles and gaps; empty without a panorama."""
    content = run.read_json("panorama.json")
    if content is None:
        return ""
    body = ""
    if run.has("panorama_obstacles.png"):
        data = run.path("panorama_obstacles.png").read_bytes()
        body = (
            f'<figure class="plot">{_image("png", data, "range panorama with obstacles")}</figure>'
        )
    body += table(
        ("obstacle", "azimuth, deg", "distance, m", "width, m", "height, m"),
        [
            (
                number + 1,
                f"{_degrees(one, 'right_rad')} to {_degrees(one, 'left_rad')}",
                *(_measured(one, name) for name in ("distance", "width", "height")),
            )
            for number, one in enumerate(content.get("obstacles", []))
        ],
    )
    body += table(
        ("gap", "azimuth, deg", "distance, m", "passable width, m"),
        [
            (
                number + 1,
                f"{_degrees(gap, 'right_rad')} to {_degrees(gap, 'left_rad')}",
                _number(gap.get("distance_m"), "{:.2f}"),
                _measured(gap, "width"),
            )
            for number, gap in enumerate(content.get("gaps", []))
        ],
    )
    views = content.get("views", [])
    missing = [view for view in views if not view["placed"]]
    if missing:
        body += table(
            ("frame that is not placed", "reason"),
            [(view["frame"], view.get("reason", "")) for view in missing],
        )
    sentence = (
        "Range from the centre of the panorama, with the numbers of the obstacles above and of the gaps below. Azimuth is positive to the left, "
        "in the picture about its centre and in the tables about the base, which differs for what is near; "
        "distance is measured straight ahead, width across; ± is one standard deviation. "
        f"{len(views) - len(missing)} of {len(views)} views are placed."
    )
    return _section("panorama", "Panorama", sentence, body)


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """An HTML table."""
    head = "".join(f"<th>{html.escape(name)}</th>" for name in header)
    body = "\n".join(
        "<tr>" + "".join(f"<td>{html.escape(str(value))}</td>" for value in row) + "</tr>"
        for row in rows
    )
    return f"<table>\n<tr>{head}</tr>\n{body}\n</table>"


def figure_rows(metrics: dict[str, Any]) -> list[str]:
    """Every figure of metrics.json as a table row."""
    rows = []
    for name, value in metrics.items():
        if name == "timing_ms":
            shown = {
                f"{name}.{stage}": f"{t['p50']:.2f} / {t['p95']:.2f} / {t['max']:.2f}"
                for stage, t in value.items()
            }
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            shown = {name: f"{value:.6g}"}
        else:
            shown = {name: str(value).lower() if isinstance(value, bool) else str(value or "none")}
        rows += [
            f'<tr><td><code>{html.escape(key)}</code></td><td class="number">{html.escape(text)}</td></tr>'
            for key, text in shown.items()
        ]
    return rows


def _section(identity: str, title: str, sentence: str, body: str) -> str:
    return (
        f'<section id="{identity}">\n<h2>{html.escape(title)}</h2>\n'
        f"<p>{html.escape(sentence)}</p>\n{body}\n</section>"
    )


def _slider(title: str, sentence: str, shots: Sequence[tuple[str, str]]) -> str:
    """Pictures of several instants, as (label, HTML); starts with those of most detail, which compress least."""
    if not shots:
        return ""
    first = max(range(len(shots)), key=lambda k: len(shots[k][1]))
    listed = "\n".join(
        f'<div class="shot" data-label="{html.escape(label)}">{figures}</div>'
        for label, figures in shots
    )
    return (
        f'<section id="views" class="views">\n<h2>{html.escape(title)}</h2>\n<p>{html.escape(sentence)}</p>\n'
        '<div class="slider"><input id="instant" type="range" min="0" '
        f'max="{len(shots) - 1}" value="{first}" aria-label="instant">'
        f'<output id="label" for="instant"></output></div>\n{listed}\n</section>'
    )


def _captioned(kind: str, data: bytes, caption: str) -> str:
    image = _image(kind, data, caption)
    return f"<figure>{image}<figcaption>{html.escape(caption)}</figcaption></figure>"


def _image(kind: str, data: bytes, alt: str) -> str:
    content = base64.b64encode(data).decode("ascii")
    return f'<img alt="{html.escape(alt)}" src="data:image/{kind};base64,{content}">'


def _number(value: float | None, shown: str) -> str:
    return "unknown" if value is None else shown.format(value)


def _degrees(one: dict[str, Any], name: str) -> str:
    value = one.get(name)
    return _number(None if value is None else math.degrees(value), "{:z.0f}")


def _measured(one: dict[str, Any], name: str) -> str:
    """A length with its standard deviation, to the first digit of the latter."""
    value, sigma = one.get(f"{name}_m"), one.get(f"sigma_{name}_m")
    if value is None or not sigma:
        return _number(value, "{:.2f}")
    digits = min(max(-math.floor(math.log10(sigma)), 2), 4)
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"
