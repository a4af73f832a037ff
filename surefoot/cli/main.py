"""The program `surefoot`: all its verbs.

Heavy packages are imported inside the verbs, so that help is fast.
"""

from __future__ import annotations

import logging
import os

import click

from .batch_verbs import batch
from .experiment_verbs import experiment, reproduce
from .quickstart import quickstart
from .recording_verbs import calibrate_noise, map_verb, merge, monocular, panorama
from .robot_verbs import robots
from .run_verbs import process, simulate, smooth, soak
from .share_verbs import export, film
from .store_verbs import compare, query
from .study_verbs import bench, completion, doctor, evaluate, replay, settings, view
from .terminal import Verbs

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # one thread is faster on small matrices
os.environ.setdefault("NUMBA_THREADING_LAYER", "workqueue")


@click.group(cls=Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--debug", is_flag=True, help="Show the full traceback of unexpected errors.")
@click.version_option(package_name="surefoot")
def main(debug: bool) -> None:
    """A humanoid robot sees where it may step.

    \b
    See a first result in 20 seconds:
      surefoot quickstart
    Walk through a simulated home and record the sensors:
      surefoot simulate home --seed 3 --record --out runs/home3
    Process a recording (your own or that one) and evaluate the result:
      surefoot process runs/home3 --out runs/offline
      surefoot evaluate runs/offline
      surefoot view runs/offline
    """
    shown = logging.BASIC_FORMAT if debug else "warning: %(message)s"
    logging.basicConfig(level=logging.WARNING, format=shown)
    for package in ("perception", "mapping", "planning", "sim", "surefoot"):
        logging.getLogger(package).setLevel(logging.DEBUG if debug else logging.WARNING)
    # Matplotlib warns about a home that it cannot write
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


for _verb in (
    quickstart, simulate, soak, process, batch, smooth, map_verb, merge, panorama, monocular, calibrate_noise,
    evaluate, query, compare, view, replay, film, export, experiment, reproduce, bench, robots, settings, doctor,
    completion,
):  # fmt: skip
    main.add_command(_verb)
