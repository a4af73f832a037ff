"""Pages made from result files: the gallery of the experiments, and the benchmarks.

An experiment leaves runs/experiments/ID/ with result.json and figure.png or figure.svg; `surefoot bench --json` kept as
runs/bench.json holds the benchmarks. What is not there is said to be not run here.
Code such as `003-E1` in any page links to the page of that experiment.
"""

from __future__ import annotations

import json
import os
import shutil
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.transforms.post_transforms import SphinxPostTransform

ROOT = Path(__file__).resolve().parents[2]
RUNS = Path(os.environ.get("SUREFOOT_RUNS", ROOT / "runs"))
THEORY = {"000": "monocular", "001": "gaze", "003": "stereo", "004": "panorama"}


def setup(app: Any) -> dict[str, bool]:
    """Write the pages; link the identities."""
    app.connect("builder-inited", _write_pages)
    app.add_post_transform(_Links)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


class _Links(SphinxPostTransform):
    """Code that is the identity of an experiment becomes a link to its page."""

    default_priority = 200

    def run(self, **kwargs: Any) -> None:
        from surefoot.experiments.support.experiment import FILES

        for code in list(self.document.findall(nodes.literal)):
            name = code.astext()
            known = name in FILES and "-" in name  # `home` is a scene, `mrclam` a format
            if not known or isinstance(code.parent, nodes.reference):
                continue
            page = f"gallery/{name}"
            if page == self.env.docname:
                continue
            address = self.app.builder.get_relative_uri(self.env.docname, page)
            link = nodes.reference("", "", refuri=address, internal=True)
            code.replace_self(link)
            link += code


def _write_pages(app: Any) -> None:
    from surefoot.benchmarks import benchmark
    from surefoot.experiments.support import experiment as experiments
    from surefoot.experiments.support.papers import HEADINGS, room_of

    folder = Path(app.srcdir) / "gallery"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    cards: dict[str, list[str]] = {}
    for name in experiments.names():
        one = experiments.load(name)
        result = _read(RUNS / "experiments" / name / "result.json")
        pictures = _pictures(name, result, folder)
        (folder / f"{name}.md").write_text(_page(one, result, pictures), encoding="utf-8")
        cards.setdefault(room_of(name), []).append(_card(one, result, pictures))
    lines = [OPENING]
    for room, found in cards.items():
        lines += [f"## {HEADINGS[room]}", ""]
        if room in THEORY:
            lines += [
                f"[Its equations and what was wrong in print](../theory/{THEORY[room]}.md).",
                "",
            ]
        lines += ["::::{container} gallery", *found, "::::", ""]
    lines += ["```{toctree}", ":hidden:", *experiments.names(), "benchmarks", "```", ""]
    (folder / "index.md").write_text("\n".join(lines), encoding="utf-8")
    measured = {one["id"]: one for one in _read(RUNS / "bench.json") or []}
    lines = [BENCHMARKS]
    for name in benchmark.names():
        lines += _benchmark(benchmark.load(name), measured.get(name))
    (folder / "benchmarks.md").write_text("\n".join(lines), encoding="utf-8")


OPENING = """# Experiments

Each experiment measures a table or figure of a paper again, or what the papers together can do.
`surefoot experiment ID` runs one and leaves its result in `runs/experiments/ID/`; `surefoot experiment` lists them.
The figures, verdicts and pictures here were read from such folders when these pages were built.
"""

BENCHMARKS = """# Benchmarks

`surefoot bench` times our hot paths against those of other libraries: median processor time of 15 rounds on one core,
all candidates in turn. A ratio above 1 says that ours is faster; a bound is the smallest ratio that passes.
`make bench` installs the peers. Keep the results with `surefoot bench --json > runs/bench.json`; these pages show them
when they are built again.
"""


def _read(file: Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None


Picture = tuple[str, str]
"""File beside the page, and the sentence below it."""


def _pictures(name: str, result: dict[str, Any] | None, folder: Path) -> list[Picture]:
    """Copy the pictures of an experiment beside its page."""
    found = []
    for one in result["pictures"] if result else ():
        for kind in ("svg", "png"):
            file = RUNS / "experiments" / name / f"{one['name']}.{kind}"
            if file.is_file():
                copy = f"{name}-{file.name}"
                shutil.copyfile(file, folder / copy)
                found.append((copy, one["sentence"]))
                break
    return found


def _verdict(result: dict[str, Any] | None) -> str:
    if result is None:
        return "not run here"
    if not result["targets"]:
        return "measured; has no targets"
    met = sum(_met(result, name) for name in result["targets"])
    return f"{met} of {len(result['targets'])} targets met"


def _met(result: dict[str, Any], name: str) -> bool:
    from surefoot.experiments.support.experiment import Target

    relation, bound = result["targets"][name]
    figure = result["figures"].get(name)
    return figure is not None and Target(relation, bound).met_by(figure)


def _card(one: Any, result: dict[str, Any] | None, pictures: list[Picture]) -> str:
    shown = [":::{container} card"]
    if pictures:
        shown += [f"[![{_plain(one.title)}]({pictures[0][0]})]({one.id}.md)", ""]
    shown += [f"[**{one.id}**]({one.id}.md) {_plain(one.title)}", ""]
    return "\n".join([*shown, f"*{_verdict(result)}*", ":::"])


def _page(one: Any, result: dict[str, Any] | None, pictures: list[Picture]) -> str:
    from surefoot.experiments.support.papers import origin

    source = origin(one)
    lines = [f"# {one.id}: {_plain(one.title)}", ""]
    for paper in source.papers:
        page = f"../theory/{THEORY[paper.key.split()[1]]}.md"
        lines += [f"{_plain(paper.words())} ([{paper.key}]({page}))", ""]
    lines += [f"**{_verdict(result).capitalize()}.**", ""]
    if result is not None:
        said = {"seeds": "seeds", "seconds": "time, s", "version": "version", "commit": "commit"}
        facts = [f"{word}: {result[key]}" for key, word in said.items() if result.get(key)]
        lines += ["; ".join(facts) + ".", ""]
    for file, sentence in pictures:
        lines += [f"![{_plain(sentence)}]({file})", "", f"*{_plain(sentence)}*", ""]
    lines += (
        [*_prose(source.about), "", f"Source: {_plain(source.source)}", ""]
        if source.source
        else _prose(source.about)
    )
    lines += [
        "",
        "```sh",
        f"surefoot experiment {one.id}",
        "```",
        "",
        *_columns(result),
        *_figures(one, result),
    ]
    if result is not None and result.get("table"):
        lines += ["", "As the command prints it:", "", "```text", *result["table"], "```"]
    return "\n".join(lines) + "\n"


def _columns(result: dict[str, Any] | None) -> list[str]:
    """The method of the paper beside ours, where the experiment runs both."""
    rows = (result or {}).get("columns") or []
    if not rows or result is None:
        return []
    lines = ["| | paper | its method here | ours |", "|---|---|---|---|"]
    for words, printed, *names in rows:
        found = [printed, *(result["figures"].get(name) for name in names)]
        cells = ["" if value is None else f"{value:.4g}" for value in found]
        lines.append("| " + " | ".join([_plain(words.strip()), *cells]) + " |")
    return [*lines, ""]


def _figures(one: Any, result: dict[str, Any] | None) -> list[str]:
    """The figures as a table: measured, target, published."""
    figures = result["figures"] if result else {}
    intervals = (result or {}).get("intervals") or {}
    names = list(dict.fromkeys([*figures, *one.targets, *one.published]))
    if not names:
        return []
    lines = ["| figure | measured | 95 % | target | met | paper |", "|---|---|---|---|---|---|"]
    for name in names:
        figure, target = figures.get(name), one.targets.get(name)
        interval = intervals.get(name)
        cells = [
            f"`{name}`",
            "" if figure is None else f"{figure:.4g}",
            f"{interval[0]:.4g} to {interval[1]:.4g}" if interval else "",
            "" if target is None else f"{_plain(target.relation)} {target.bound:g}",
            "" if target is None or result is None else ("yes" if _met(result, name) else "**no**"),
            f"{one.published[name]:g}" if name in one.published else "",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _benchmark(one: Any, result: dict[str, Any] | None) -> list[str]:
    lines = [f"## {one.name}: {_plain(one.title)}", ""]
    if result is None:
        bars = "; ".join(f"`{name}` at least {bar:g}" for name, bar in one.bars.items())
        return [*lines, f"Not run here. Bounds of the ratios: {bars or 'none'}.", ""]
    lines += ["| peer | ratio | bound |", "|---|---|---|"]
    for name, ratio in result["ratios"].items():
        bound = result["targets"].get(name)
        lines.append(f"| `{name}` | {ratio:.2f} | {f'{bound[1]:g}' if bound else ''} |")
    lines += ["", "| figure | value |", "|---|---|"]
    lines += [f"| `{name}` | {value:.4g} |" for name, value in result["figures"].items()]
    return [*lines, ""]


def _prose(text: str) -> list[str]:
    """A docstring as Markdown."""
    return [_plain(line) if line.strip() else "" for line in text.strip().splitlines()]


def _plain(text: str) -> str:
    """Text in which nothing is markup but `code`."""
    parts = text.split("`")
    for at in range(0, len(parts), 2):
        parts[at] = (
            escape(parts[at], quote=False)
            .replace("*", "\\*")
            .replace("_", "\\_")
            .replace("$", "\\$")
        )
        parts[at] = parts[at].replace("[", "\\[").replace("|", "\\|")
    return "`".join(parts)
