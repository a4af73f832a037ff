"""The walking loop: read, estimate, decide, act, record."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from perception.estimate import Estimate
from perception.primitives.frame import Frame

from ..planners import Planner
from .bodies import Body
from .pipeline import Pipeline
from .run_recorder import Journal
from .stopwatch import Stopwatch

if TYPE_CHECKING:
    pass
from .summary import Say


def walk_loop(
    body: Body,
    pipeline: Pipeline,
    planner: Planner | None,
    journal: Journal,
    say: Say,
    after: Callable[[float], None] = lambda stamp_s: None,
    page: Callable[[Frame, Pipeline, Estimate, Planner | None], None] | None = None,
    aside: Callable[[], None] = lambda: None,
) -> None:
    """Read, estimate, decide, act, write down; until the goals are reached or the frames end."""
    while (frame := body.read()) is not None:
        after(frame.stamp_s)
        estimate = pipeline.cycle(frame)
        decision, watch = None, Stopwatch()
        if planner is not None:
            with watch.stage("decide"):
                planner.notice(frame, estimate, pipeline)
                estimate = pipeline.told(estimate)
                if frame.footstep_due:
                    decision = planner.decide(frame, estimate, pipeline)
        estimate.timing_ms.update(watch.milliseconds)
        if decision is not None:
            body.walk(decision.walk)
            body.look(decision.gaze)
        journal.note(frame, estimate, decision)
        aside()
        if page is not None:
            page(frame, pipeline, estimate, planner)
        say(journal.progress(estimate, planner))
        if planner is not None and planner.finished(estimate):
            break
