"""Pages made from result files: the gallery of the experiments, and the benchmarks.

An experiment leaves runs/experiments/ID/ with result.json and figure.png or figure.svg; `surefoot bench --json` kept as
runs/bench.json holds the benchmarks. What is not there is said to be not run here.
Code such as `003-E1` in any page links to the page of that experiment.
"""

from __future__ import annotations

import importlib
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
PAPERS = {
    "000": ("Han, Kim, Hong 2018", "../theory/monocular.md"),
    "001": ("Yoo, Kim 2010", "../theory/gaze.md"),
    "003": ("the stereo walker", "../theory/stereo.md"),
    "004": ("Kang, Lim, Park, Kim 2013", "../theory/panorama.md"),
}
ROOMS = {
    "seed_000": "Han, Kim, Hong 2018 (seed 000): one camera, floor by colour, swarm over the image",
    "seed_001": "Yoo, Kim 2010 (seed 001): gaze by four evaluations, univector field",
    "seed_003": "The stereo walker (seed 003): stereo, randomised Hough transform, egocentric grid",
    "seed_004": "Kang, Lim, Park, Kim 2013 (seed 004): panoramas of time-of-flight depth, fuzzy choice",
    "joint": "All papers together",
    "real": "Recordings of real sensors",
}


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
            if name not in FILES or isinstance(code.parent, nodes.reference):
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

    folder = Path(app.srcdir) / "gallery"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    cards: dict[str, list[str]] = {}
    for name, module in experiments.FILES.items():
        room = module.split(".")[0]
        one = experiments.load(name)
        text = importlib.import_module(f"surefoot.experiments.{module}").__doc__ or ""
        result = _read(RUNS / "experiments" / name / "result.json")
        picture = _picture(name, folder) if result is not None else None
        (folder / f"{name}.md").write_text(_page(one, text, result, picture), encoding="utf-8")
        cards.setdefault(room, []).append(_card(one, result, picture))
    lines = [OPENING]
    for room, found in cards.items():
        lines += [f"## {ROOMS[room]}", "", "::::{container} gallery", *found, "::::", ""]
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


def _picture(name: str, folder: Path) -> str | None:
    """Copy the picture of an experiment beside its page."""
    for kind in ("png", "svg"):
        file = RUNS / "experiments" / name / f"figure.{kind}"
        if file.is_file():
            shutil.copyfile(file, folder / f"{name}.{kind}")
            return f"{name}.{kind}"
    return None


def _verdict(one: Any, result: dict[str, Any] | None) -> str:
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


def _card(one: Any, result: dict[str, Any] | None, picture: str | None) -> str:
    shown = [":::{container} card"]
    if picture is not None:
        shown += [f"[![{_plain(one.title)}]({picture})]({one.id}.md)", ""]
    shown += [
        f"[**{one.id}**]({one.id}.md) {_plain(one.title)}",
        "",
        f"*{_verdict(one, result)}*",
        ":::",
    ]
    return "\n".join(shown)


def _page(one: Any, text: str, result: dict[str, Any] | None, picture: str | None) -> str:
    lines = [f"# {one.id}: {_plain(one.title)}", ""]
    if one.id[:3] in PAPERS:
        paper, page = PAPERS[one.id[:3]]
        lines += [f"Paper: [{paper}]({page}) (seed {one.id[:3]}).", ""]
    lines += [f"**{_verdict(one, result).capitalize()}.**", ""]
    if result is not None:
        said = {"seeds": "seeds", "seconds": "time, s", "version": "version", "commit": "commit"}
        facts = [
            f"{word} {result[key]}" for key, word in said.items() if result.get(key) is not None
        ]
        lines += ["; ".join(facts), ""]
    if picture is not None:
        lines += [f"![{_plain(one.title)}]({picture})", ""]
    lines += [*_prose(text), "", "```sh", f"surefoot experiment {one.id}", "```", ""]
    names = [*(result["figures"] if result else {}), *one.targets]
    names += [name for name in one.published if name not in names]
    if names:
        lines += ["| figure | measured | target | met | paper |", "|---|---|---|---|---|"]
    for name in dict.fromkeys(names):
        figure = result["figures"].get(name) if result else None
        target = one.targets.get(name)
        cells = [
            f"`{name}`",
            "" if figure is None else f"{figure:.4g}",
            "" if target is None else f"{_plain(target.relation)} {target.bound:g}",
            "" if target is None or result is None else ("yes" if _met(result, name) else "**no**"),
            f"{one.published[name]:g}" if name in one.published else "",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    if result is not None and result.get("table"):
        table = "\n".join(result["table"])
        lines += ["", "As the command prints it:", "", "```text", table, "```"]
    return "\n".join(lines) + "\n"


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
