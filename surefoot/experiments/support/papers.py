"""The four papers, and which of them an experiment measures again.

An experiment names its source in the last paragraph of its module's docstring ("Source: ..."), with the key of the
paper, "seed 001", and the sections; what stands before is the description on its page.
"""

from __future__ import annotations

import inspect
import re
import sys
from dataclasses import dataclass

from .experiment import FILES, Experiment


@dataclass(frozen=True)
class Paper:
    """A paper, by the key that docstrings cite."""

    key: str
    short: str
    authors: str
    title: str
    where: str
    year: str

    def words(self) -> str:
        """Authors, title, place and year in one line."""
        return f"{self.authors}. {self.title}. {self.where}, {self.year}."


PAPERS = {
    "000": Paper(
        "seed 000",
        "Han 2018",
        "Y.-J. Han, I.-S. Kim, Y.-D. Hong",
        "Optimization-based humanoid robot navigation using monocular camera within indoor environment",
        "ETRI Journal",
        "2018",
    ),
    "001": Paper(
        "seed 001",
        "Yoo and Kim 2010",
        "J.-K. Yoo, J.-H. Kim",
        "Navigation framework for humanoid robots integrating gaze control and modified-univector field method to "
        "avoid dynamic obstacles",
        "IEEE/RSJ IROS",
        "2010",
    ),
    "003": Paper(
        "seed 003",
        "Stereo navigation of KMHROBO",
        "Authors and title not known to us",
        "A stereo navigation system for the humanoid KMHROBO, after K. Sabe et al., Obstacle avoidance and path "
        "planning for humanoid robots using stereo vision, IEEE ICRA 2004",
        "A Korean engineering journal",
        "year not known to us",
    ),
    "004": Paper(
        "seed 004",
        "Kang 2013",
        "T.-K. Kang, M.-T. Lim, G.-T. Park, D. W. Kim",
        "3D vision-based local path planning system of a humanoid robot for obstacle avoidance",
        "Journal of Electrical Engineering & Technology 8(4), 879-888",
        "2013",
    ),
}
ROOMS = {
    **{number: f"seed_{number}" for number in PAPERS},
    "joint": "joint",
    "real": "real",
}
"""What `reproduce` takes, and its room among the experiments."""
HEADINGS = {
    **{number: f"{paper.short} ({paper.key})" for number, paper in PAPERS.items()},
    "joint": "The four together",
    "real": "Real recordings",
}


def room_of(identity: str) -> str:
    """The key of `ROOMS` to which an experiment belongs; "joint" for one outside the registry."""
    folder = FILES.get(identity, "joint.").partition(".")[0]
    return next(name for name, room in ROOMS.items() if room == folder)


@dataclass(frozen=True)
class Origin:
    """Where an experiment comes from.

    Args:
        about: What it does and how, paragraphs of its module's docstring.
        source: Sections, tables and figures of its sources.
        papers: The papers among them.
    """

    about: str
    source: str
    papers: tuple[Paper, ...]


def origin(experiment: Experiment) -> Origin:
    """Description and sources of an experiment, from the docstring of its module."""
    function = inspect.unwrap(getattr(experiment.run, "func", experiment.run))
    text = inspect.cleandoc(sys.modules[function.__module__].__doc__ or "")
    about, found, source = text.rpartition("Source:")
    if not found:
        about, source = text, ""
    keys = re.findall(r"seed (\d{3})", source)
    room = room_of(experiment.id)
    if not keys and room in PAPERS:
        keys = [room]
    papers = tuple(PAPERS[key] for key in dict.fromkeys(keys) if key in PAPERS)
    return Origin(about.strip(), " ".join(source.split()), papers)
