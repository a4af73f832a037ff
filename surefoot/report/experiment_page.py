"""The page of an experiment, and the index of many: results beside targets and papers, with pictures.

The page of an experiment has its pictures inside and loads nothing; the index shows the pictures that lie in the
folders beside it. Both have the style of the report of a run.
"""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

MOST_PICTURES = 12  # inside the page; the others are files beside it
LARGEST_SVG = 600_000  # bytes; a larger one is shown as PNG
FILES = {
    "result.json": "everything on this page, for programs",
    "figures.csv": "every figure with interval, target and published number",
    "table.tex": "the same as LaTeX table (booktabs)",
    "config.toml": "settings of the first walk; `surefoot simulate --config` takes them",
    "figure.svg": "the main picture, also as PNG",
}
NO_NUMBER = "–"
UNMEASURED = "not measured"
RELATIONS = {"<=": "≤", ">=": "≥", "<": "&lt;", ">": "&gt;", "==": "="}


def page(result: Mapping[str, Any], verdicts: Sequence[Mapping[str, Any]], pictures: Path) -> str:
    """The page of one experiment.

    Args:
        result: Content of result.json.
        verdicts: Every target with whether it is met, and words.
        pictures: Folder with the pictures of the result.
    """
    good, words = headline(verdicts)
    shown = result["pictures"][:MOST_PICTURES]
    rest = [one["name"] for one in result["pictures"][MOST_PICTURES:]]
    drawn = [_picture(pictures, one) for one in shown]
    if rest:
        drawn.append(f"<p>More pictures in this folder: {html.escape(', '.join(rest))}.</p>")
    body = [
        f'<p class="soft">{html.escape(_subtitle(result))}</p>',
        _paper(result),
        section("Result", _picture(pictures, shown[0])),
        section("Targets", _targets(result, verdicts)),
        section("The paper, its method here, and ours", _columns(result)),
        section("More pictures", "\n".join(drawn[1:])),
        section("As printed by the experiment", _pre("\n".join(result["table"]))),
        section("What is measured, and how", _paragraphs(result["about"])),
        section("Again", _pre(result["command"]) + _files(result)),
        section("", f"<details><summary>All figures</summary>{_figures(result)}</details>"),
    ]
    return filled(f"{result['id']}: {result['title']}", good, words, body)


def index(
    title: str, groups: Sequence[tuple[str, str, Sequence[Mapping[str, Any]]]], said: str
) -> str:
    """The index of many experiments.

    Args:
        title: Heading.
        groups: Heading, words on the paper, and cards of each group. A card has id, title, state ("good", "bad" or
            "none"), words, note, and if there is a result link and picture.
        said: Words under the heading.
    """
    cards = [card for _, _, many in groups for card in many]
    good = sum(card["state"] == "good" for card in cards)
    run = sum("link" in card for card in cards)
    words = f"{run} of {len(cards)} experiments; {good} meet all targets"
    body = [f'<p class="soft">{html.escape(said)}</p>']
    for heading, paper, many in groups:
        body += [f"<h2>{html.escape(heading)}</h2>", f'<p class="soft">{html.escape(paper)}</p>']
        for kind, rows in (
            ("gallery", [_card(card) for card in many if "link" in card]),
            ("rest", [_without(card) for card in many if "link" not in card]),
        ):
            body += [f'<ul class="{kind}">', *rows, "</ul>"] if rows else []
    return filled(title, None if run < len(cards) else good == len(cards), words, body)


def headline(verdicts: Sequence[Mapping[str, Any]]) -> tuple[bool | None, str]:
    """Whether all targets are met, None if there are none or some are not measured and no other is missed; in words."""
    measured = [one for one in verdicts if one["words"] != UNMEASURED]
    met, left = sum(one["met"] for one in measured), len(verdicts) - len(measured)
    if not verdicts:
        return None, "no targets"
    words = f"{met} of {len(measured)} targets met" + (f", {left} not measured" if left else "")
    return (None if left and met == len(measured) else met == len(verdicts)), words


def filled(title: str, good: bool | None, verdict: str, body: Sequence[str]) -> str:
    """A page in the style of the reports.

    Args:
        title: Heading.
        good: Colour of the verdict; None: neither.
        verdict: Its words.
        body: Parts as HTML.
    """
    room = resources.files(__package__)
    found = re.search(r"<style>\n(.*?)</style>", room.joinpath("report_page.html").read_text("utf-8"), re.DOTALL)  # fmt: skip
    assert found is not None, "the report of a run has a style"
    return Template(room.joinpath("experiment_page.html").read_text("utf-8")).substitute(
        title=html.escape(title),
        style=found[1],
        verdict=html.escape(verdict),
        verdict_class={None: "none", True: "good", False: "bad"}[good],
        body="\n".join(part for part in body if part),
    )


def _subtitle(result: Mapping[str, Any]) -> str:
    parts = [
        f"seeds: {result['seeds']}",
        f"{result['body']} body" if result["body"] else "",
        smaller(result),
        f"{result['seconds']:.0f} s",
        f"surefoot {result['version']}",
        f"commit {result['commit']}" if result["commit"] else "",
    ]
    return " · ".join(part for part in parts if part)


def smaller(result: Mapping[str, Any]) -> str:
    """In words, by which arguments a result is of a smaller experiment than it is meant."""
    told = ", ".join(f"{name} = {value:g}" for name, value in result["smaller"].items())
    return f"smaller than meant: {told}" if told else ""


def _paper(result: Mapping[str, Any]) -> str:
    words = "".join(f"<p>{html.escape(paper)}</p>" for paper in result["papers"])
    source = f'<p class="soft">Source: {html.escape(result["source"])}</p>'
    return words + (source if result["source"] else "")


def section(heading: str, body: str) -> str:
    """A section; nothing if its body is empty."""
    head = f"<h2>{html.escape(heading)}</h2>\n" if heading else ""
    return f"<section>\n{head}{body}\n</section>" if body else ""


def _pre(text: str) -> str:
    return f"<pre>{html.escape(text)}</pre>" if text.strip() else ""


def _paragraphs(text: str) -> str:
    """Plain paragraphs, with what stands in backquotes as code."""
    blocks = re.split(r"\n\s*\n", text.strip())
    shown = (re.sub(r"`+([^`]+)`+", r"<code>\1</code>", html.escape(block)) for block in blocks)
    return '<div class="about">' + "".join(f"<p>{one}</p>" for one in shown) + "</div>"


def _picture(folder: Path, one: Mapping[str, str]) -> str:
    svg, png = (folder / f"{one['name']}.{kind}" for kind in ("svg", "png"))
    kind, path = ("svg+xml", svg) if svg.stat().st_size <= LARGEST_SVG else ("png", png)
    content = base64.b64encode(path.read_bytes()).decode("ascii")
    words = html.escape(one["sentence"])
    return (
        f'<figure class="plot"><img alt="{words}" src="data:image/{kind};base64,{content}"></figure>'
        f"<p>{words}</p>"
    )


def _targets(result: Mapping[str, Any], verdicts: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for one in verdicts:
        name = one["name"]
        rows.append(
            (
                f"<code>{html.escape(name)}</code>",
                f'<b class="{"good" if one["met"] else "bad"}">{"✓" if one["met"] else "✗"} {one["words"]}</b>',
                _number(result["figures"].get(name)),
                f"{RELATIONS[one['relation']]} {one['bound']:.6g}",
                _number(result["published"].get(name)),
                _span(result, name),
            )
        )
    header = ("figure", "verdict", "measured", "target", "paper", "95 % interval")
    said = f'<p class="soft">{html.escape(result["intervals_said"])}</p>'
    return (numbers_table(header, rows) + said) if rows else ""


def _columns(result: Mapping[str, Any]) -> str:
    figures = result["figures"]
    rows = []
    for words, paper, *names in result["columns"]:
        cells = [_number(figures.get(k)) if k else "" for k in names]
        paper = "none printed" if paper is None else _number(paper)
        rows.append((html.escape(words), paper, *cells))
    return numbers_table(("", "paper", "its method here", "ours"), rows) if rows else ""


def _figures(result: Mapping[str, Any]) -> str:
    rows = [
        (f"<code>{html.escape(name)}</code>", _number(value), _number(result["published"].get(name)), _span(result, name))
        for name, value in result["figures"].items()
    ]  # fmt: skip
    return numbers_table(("figure", "measured", "paper", "95 % interval"), rows)


def _files(result: Mapping[str, Any]) -> str:
    rows = [
        (f"<code>{name}</code>", re.sub(r"`([^`]+)`", r"<code>\1</code>", words))
        for name, words in FILES.items()
        if name in result["files"]
    ]
    body = "".join(f"<tr><td>{name}</td><td>{words}</td></tr>" for name, words in rows)
    return f'<div class="tablewrap"><table>{body}</table></div>'


def numbers_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of HTML cells; all but the first column are numbers, and a column without any is left out."""
    kept = [k for k in range(len(header)) if not k or any(row[k] != NO_NUMBER for row in rows)]
    header, rows = [header[k] for k in kept], [[row[k] for k in kept] for row in rows]
    head = "".join(f'<th class="{"number" if k else ""}">{name}</th>' for k, name in enumerate(header))  # fmt: skip
    body = "\n".join(
        "<tr>" + "".join(f'<td class="{"number" if k else ""}">{cell}</td>' for k, cell in enumerate(row)) + "</tr>"
        for row in rows
    )  # fmt: skip
    return f'<div class="tablewrap"><table>\n<tr>{head}</tr>\n{body}\n</table></div>'


def _number(value: float | None) -> str:
    return NO_NUMBER if value is None else f"{value:.4g}"


def _span(result: Mapping[str, Any], name: str) -> str:
    found = result["intervals"].get(name)
    return NO_NUMBER if found is None else f"{found[0]:.4g} to {found[1]:.4g}"


def _card(card: Mapping[str, Any]) -> str:
    """One experiment of the index that has a result."""
    return (
        f'<li><a href="{html.escape(card["link"])}">'
        f'<span class="thumb"><img loading="lazy" alt="" src="{html.escape(card["picture"])}"></span>'
        f'<span class="words"><b>{html.escape(card["id"])}</b><span>{html.escape(card["title"])}</span>'
        f'<span class="verdict {card["state"]}">{html.escape(card["words"])}</span>'
        f'<span class="soft">{html.escape(card["note"])}</span></span></a></li>'
    )


def _without(card: Mapping[str, Any]) -> str:
    """One experiment of the index without a result."""
    note = f": {card['note']}" if card["note"] else ""
    words = html.escape(f"{card['words']}{note}")
    return f'<li><b>{html.escape(card["id"])}</b> {html.escape(card["title"])} <span class="soft">({words})</span></li>'
