"""Questions with a name, for `surefoot query NAME RUNS`, and to start from."""

from __future__ import annotations

from typing import NamedTuple


class Example(NamedTuple):
    """What is asked, in words and in SQL."""

    words: str
    sql: str


EXAMPLES: dict[str, Example] = {
    "overview": Example(
        "one line per kind of run and version: number, errors, time",
        """
        SELECT kind, version, "commit", count(*) AS runs, sum(frames) AS frames, sum(skipped) AS skipped,
               median(ate_m) AS ate_m, quantile_cont(ate_m, 0.95) AS ate_p95_m, avg(pose_nees) AS pose_nees,
               sum(false_movers) AS false_movers, sum(contacts) AS contacts, median(frame_ms) AS frame_ms
        FROM runs JOIN metrics USING (run) GROUP BY ALL ORDER BY ALL
        """,
    ),
    "worst": Example(
        "the twenty runs with the largest position errors",
        """
        SELECT run, ate_m, position_rmse_m, pose_nees, floor_share, skipped, doubts
        FROM metrics ORDER BY coalesce(position_rmse_m, ate_m) DESC NULLS LAST, run LIMIT 20
        """,
    ),
    "worst-frames": Example(
        "the frames with the largest position errors, and what they claimed",
        """
        SELECT run, stamp_s, error_m, sqrt(P_xx + P_yy) AS sigma_m, state
        FROM frames WHERE error_m IS NOT NULL ORDER BY error_m DESC, run, stamp_s LIMIT 20
        """,
    ),
    "floor": Example(
        "by camera: share of the rows in which the floor was found, claimed sigma of tilt and height",
        """
        SELECT camera, count(*) AS frames, avg(CAST(state = 'seen' AS INTEGER)) AS seen,
               degrees(sqrt(median(greatest(P00, P11)))) AS tilt_sigma_deg, 1e3 * sqrt(median(P22)) AS height_sigma_mm
        FROM floors GROUP BY camera ORDER BY camera
        """,
    ),
    "movers": Example(
        "tracks that count as moving: how long, how fast, how sure",
        """
        SELECT run, track, min(stamp_s) AS from_s, max(stamp_s) AS to_s, max(sqrt(vx_mps ^ 2 + vy_mps ^ 2)) AS fastest_mps,
               arg_max(moving, stamp_s) AS moving_at_the_end
        FROM tracks GROUP BY run, track HAVING moving_at_the_end > 0.5 ORDER BY run, track
        """,
    ),
    "decisions": Example(
        "reasons of the decisions: how often, and the risk of contact they took",
        """
        SELECT why, count(*) AS times, count(DISTINCT run) AS runs, avg(risk) AS risk, max(risk) AS largest_risk
        FROM decisions GROUP BY why ORDER BY times DESC, why
        """,
    ),
    "slow": Example(
        "the slowest runs, and their frames per second",
        """
        SELECT run, frame_ms, frame_p95_ms, 1e3 / frame_ms AS frames_per_s, frames
        FROM metrics ORDER BY frame_p95_ms DESC NULLS LAST, run LIMIT 20
        """,
    ),
    "settings": Example(
        "settings in which the runs differ, with the error of each value",
        """
        SELECT setting, value, count(*) AS runs, median(ate_m) AS ate_m
        FROM config JOIN metrics USING (run)
        WHERE setting IN (SELECT setting FROM config GROUP BY setting HAVING count(DISTINCT value) > 1)
        GROUP BY setting, value ORDER BY setting, value
        """,
    ),
}
