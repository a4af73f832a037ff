"""All experiments, or those of one paper, one after the other, and one page that shows them.

A finished experiment of the same code with at least as many seeds is not run again, and an interrupted one continues.
One that fails, or whose recordings are absent, is named on the page with its error, and the others go on.

Source: ours.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from mapping.io.atomic_write import atomic_path
from perception.primitives.errors import InputError, OutputError

from ...progress import Say, silent
from ...report import experiment_page
from ...results.formats import refuse
from ...run.end_with_parent import end_with_parent
from . import artefacts
from . import experiment as experiments
from .experiment import Experiment
from .papers import HEADINGS, PAPERS, ROOMS, room_of
from .trials import code_hash

INDEX = "index.html"
QUICK: dict[str, int] = {
    "000-E2": 5, "000-E5": 2, "001-E1": 3, "001-E2": 2, "003-E3": 2, "003-E4": 50, "003-E5": 50,
    "004-E2": 10, "batch": 6,
}  # fmt: skip
"""Seeds of `--quick` by experiment; one for those that are not listed."""
SMALLER: dict[str, dict[str, float | int]] = {
    "000-E3": {"limit_s": 4.0},
    "000-E4": {"limit_s": 5.0},
    "001-E3": {"image_seeds": 0, "peers": False},
    "001-E4": {"courses": False},
    "001-hard": {"baselines": False},
    "003-E6": {"limit_s": 12.0},
    "003-E7": {"limit_s": 5.0},
    "004-E3": {"motions": 1},
    "004-E4": {"motions": 1},
    "004-E5": {"scenes": 2, "ablated": False},
    "INT-1": {"limit_s": 8.0},
    "INT-4": {"limit_s": 8.0},
    "building": {"minutes": 0.3},
    "faults": {"faults": 1},
    "gaze-benchmark": {"limit_s": 12.0},
    "home": {"limit_s": 15.0},
    "localisation": {"other_noise": False, "length_m": 3.0},
    "mrclam": {"robot_logs": False},
    "prediction": {"seconds": 20.0},
    "real-honesty": {"floors_alone": True},
    "real-mapping": {"parts": 1},
    "real-odometry": {"sets": 1},
    "real-panorama": {"parts": 2},
    "referee": {"sets": 1},
    "robots": {"limit_s": 8.0},
    "sensors": {"each": 1},
    "sessions": {"small": True},
    "strangers": {"laws": 1, "limit_s": 12.0},
    "two-physics": {"commands": 10, "limit_s": 8.0},
    "walking": {"commands": 30},
}
"""Arguments that make an experiment smaller in a quick round, where one seed of it takes minutes."""
ABOUT = {
    "joint": "The parts of all four on one robot, and the simulation they walk in.",
    "real": "The same methods on recordings of real cameras and robots.",
}

Notes = Mapping[str, str]


@dataclass(frozen=True)
class Told:
    """How one experiment of a round ended: "done", "kept", "absent" or "failed", in words, and after which time."""

    id: str
    state: str
    words: str
    seconds: float


STOPPED = ("absent", "failed")


def quick_seeds(experiment: Experiment) -> int:
    """Seeds of an experiment in a quick round; never more than in a whole one."""
    return min(QUICK.get(experiment.id, 1), experiment.seeds)


def chosen(paper: str | None) -> list[str]:
    """Ids of the experiments of one key of `ROOMS`; None: all."""
    return [name for name in experiments.names() if paper is None or room_of(name) == paper]


def reproduce(
    paper: str | None, quick: bool, folder: Path, say: Say, tell: Say, jobs: int = 1
) -> list[Told]:
    """Run what is not finished, and write the index after every experiment.

    Args:
        paper: One of `ROOMS`; None: all experiments.
        quick: With few seeds.
        folder: Of the index; every experiment has a folder in it.
        say: Takes lines of progress.
        tell: Takes one line for every experiment that has ended.
        jobs: Experiments at the same time, each in a process of its own; they disturb each other's measured times.

    Raises:
        OutputError: The folder cannot be written.
    """
    told: list[Told] = []
    identities = chosen(paper)
    for one in _ended(identities, quick, folder, say, jobs):
        told.append(one)
        tell(f"{one.id:<15} {one.seconds:7.1f} s  {one.state}: {one.words}")
        write_index(folder, {each.id: each.words for each in told if each.state in STOPPED})
    return told


def _ended(
    identities: Sequence[str], quick: bool, folder: Path, say: Say, jobs: int
) -> Iterator[Told]:
    """Every experiment as soon as it has ended."""
    if jobs == 1:
        for number, identity in enumerate(identities):
            place = f"{number + 1} of {len(identities)}, {identity}"
            yield _one(identity, quick, folder, partial(_say_at, say, place))
        return
    context = get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=end_with_parent) as pool:
        long_first = sorted(identities, key=lambda name: name not in SMALLER)
        waiting = {pool.submit(_one, name, quick, folder, silent): name for name in long_first}
        try:
            for number, done in enumerate(as_completed(waiting)):
                try:
                    yield done.result()
                except BrokenProcessPool as error:
                    yield Told(waiting[done], "failed", f"its process died: {error}", 0.0)
                say(f"{number + 1} of {len(identities)} experiments")
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _say_at(say: Say, place: str, text: str) -> None:
    say(f"{place}: {text}")


def _one(identity: str, quick: bool, folder: Path, say: Say) -> Told:
    """Run one experiment unless it is finished."""
    began_s = time.monotonic()
    try:
        state, words = _run(identity, quick, folder, say)
    except OutputError:
        raise
    except InputError as error:
        state, words = "absent", str(error)
    except Exception as error:  # whatever one experiment does, the others run
        state, words = "failed", f"{type(error).__name__}: {error}"
    return Told(identity, state, words, round(time.monotonic() - began_s, 1))


def _run(identity: str, quick: bool, folder: Path, say: Say) -> tuple[str, str]:
    """State and verdict of one experiment, run or kept."""
    experiment = experiments.load(identity)
    seeds = quick_seeds(experiment) if quick else experiment.seeds
    earlier = artefacts.read(folder / identity)
    if earlier is not None and _serves(earlier, experiment, seeds, quick):
        return "kept", _verdict(earlier)
    smaller = SMALLER.get(identity, {}) if quick else {}
    command = f"surefoot experiment {identity} --seeds {seeds}"
    if smaller:
        command = f"surefoot reproduce {room_of(identity)} --quick"
    order = artefacts.Order(experiment, seeds, None, command, resume=True, smaller=smaller)
    return "done", _verdict(artefacts.perform(order, folder / identity, say))


def _serves(result: Mapping[str, Any], experiment: Experiment, seeds: int, quick: bool) -> bool:
    """Whether a finished result is of this code, body and at least as many seeds, and as large as wanted."""
    return (
        result.get("code") == code_hash()[: artefacts.CODE_LETTERS]
        and result.get("body") == experiment.body
        and result.get("seeds", 0) >= seeds
        and (quick or not result.get("smaller"))
    )


def _verdict(result: Mapping[str, Any]) -> str:
    return experiment_page.headline(artefacts.verdicts(result))[1]


def write_index(folder: Path, errors: Notes) -> Path:
    """Write the page of all experiments from the results that lie in the folder.

    Args:
        folder: Of the index.
        errors: Words on experiments that could not run, by id.

    Raises:
        OutputError: The folder cannot be written.
    """
    groups = []
    for key in ROOMS:
        words = PAPERS[key].words() if key in PAPERS else ABOUT[key]
        groups.append((HEADINGS[key], words, [_card(name, folder, errors) for name in chosen(key)]))
    said = (
        "Every published table and figure that can be measured again, and ours beside it. "
        "Each page has its targets, intervals, command and settings."
    )
    text = experiment_page.index("Experiments of Surefoot", groups, said)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        refuse(error, folder)
    with atomic_path(folder / INDEX) as part:
        part.write_text(text, encoding="utf-8")
    return folder / INDEX


def _card(identity: str, folder: Path, errors: Notes) -> dict[str, str]:
    """What the index shows of one experiment."""
    result = artefacts.read(folder / identity)
    if result is None:
        title = experiments.load(identity).title
        note, words = errors.get(identity, ""), "could not run" if identity in errors else "not run"
        return {"id": identity, "title": title, "state": "none", "words": words, "note": note}
    good, words = experiment_page.headline(artefacts.verdicts(result))
    misses = [f"{one['name']} {one['words']}" for one in artefacts.verdicts(result) if not one["met"]]  # fmt: skip
    note = "; ".join(misses[:2]) + (f"; {len(misses) - 2} more" if len(misses) > 2 else "")
    if identity in errors:
        note = f"an earlier result; now: {errors[identity]}"
    told = [f"seeds: {result['seeds']}", experiment_page.smaller(result), note]
    return {
        "id": identity,
        "title": result["title"],
        "state": {None: "none", True: "good", False: "bad"}[good],
        "words": words,
        "note": ". ".join(part for part in told if part),
        "link": f"{identity}/report.html",
        "picture": f"{identity}/{artefacts.MAIN}.png",
    }
