"""Ranges of the time-of-flight camera from PyBullet's camera against ray casting, part of the experiment `sensors`.

Both look from the same poses along the same rays. Compared are what the rays meet up to 3 m, away from edges, and whole
measurements with the same noise. A ray that only one of the two sees counts as infinitely wrong. Times are wall clock
and belong to this machine; no target binds them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.pose import Pose3
from sim.rendering.renderer import choose_renderer
from sim.rendering.surfaces import Hits
from sim.scene import Scene
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.world import World

from ..support.experiment import Outcome, Say
from ..support.simulated_depth import on_one_surface

NEAREST_M, FARTHEST_M = 0.3, 3.0  # from where an SR-4000 measures; reach of the pipeline


@dataclass
class _Compared:
    """What one renderer and ray casting answered, all views together."""

    range_mm: list[np.ndarray] = field(default_factory=list)
    final_mm: list[np.ndarray] = field(default_factory=list)
    material: list[np.ndarray] = field(default_factory=list)
    rendered_s: list[float] = field(default_factory=list)
    cast_s: list[float] = field(default_factory=list)

    def row(self, renderer: str) -> tuple[dict[str, float], str]:
        """Figures of the renderer, and its line of the table."""
        half, most = np.percentile(np.concatenate(self.range_mm), [50, 99])
        final = float(np.percentile(np.concatenate(self.final_mm), 99))
        wrong = float(np.mean(np.concatenate(self.material)))
        rendered, cast = (1e3 * float(np.median(t)) for t in (self.rendered_s, self.cast_s))
        line = (
            f"{renderer:<5}  {half:.4f} / {most:.3f}   {final:.2f}   {wrong:.1e}   "
            f"{rendered:.0f} ms (rays {cast:.0f} ms)"
        )
        figures = {
            f"{renderer}_range_median_mm": float(half),
            f"{renderer}_range_p99_mm": float(most),
            f"{renderer}_range_noisy_p99_mm": final,
            f"{renderer}_material_wrong_share": wrong,
            f"{renderer}_range_ms": rendered,
            "rays_range_ms": cast,
        }
        return figures, line


def range_errors(views: Sequence[tuple[Scene, Pose3]], say: Say) -> Outcome:
    """PyBullet's ranges against ray casting, for each renderer that works on this machine.

    The figures `pybullet_*` are those of the worse renderer.
    """
    renderers = [name for name in ("egl", "tiny") if name in ("tiny", choose_renderer("auto"))]
    figures: dict[str, float] = {}
    table = [
        "ranges from PyBullet against rays, 0.3 to 3 m: median / p99 mm, p99 mm of measurements with the same noise, "
        "share of wrong material, time of one measurement"
    ]
    for renderer in renderers:
        compared = _Compared()
        for number, (scene, pose) in enumerate(views):
            with World(scene, renderer) as world:
                _compare(world, pose, number, compared)
            say(f"ranges by {renderer}: {number + 1} of {len(views)} views")
        found, line = compared.row(renderer)
        figures |= found
        table.append(line)
    for name in ("range_median_mm", "range_p99_mm"):
        figures[f"pybullet_{name}"] = max(figures[f"{one}_{name}"] for one in renderers)
    return Outcome(figures, table)


def _compare(world: World, pose: Pose3, number: int, compared: _Compared) -> None:
    camera = TofConfig().camera
    shape = (camera.height, camera.width)
    sources = {name: world.ranges(name) for name in ("camera", "rays")}
    rendered, cast = (one.look(camera, pose) for one in sources.values())  # also builds the scenes
    length = np.linalg.norm(camera.rays, axis=-1)
    true = cast.distance_m.reshape(shape).astype(np.float64)
    judged = on_one_surface(true / length) & (true >= NEAREST_M) & (true < FARTHEST_M)
    compared.range_mm.append(1e3 * _apart(rendered, cast, judged))
    compared.material.append((rendered.albedo != cast.albedo).reshape(shape)[judged])
    measured = {}
    for name, spent in (("camera", compared.rendered_s), ("rays", compared.cast_s)):
        tof = TofCamera(TofConfig(), np.random.default_rng([number, 65]))
        tof.measure(sources[name], pose)  # caches the rays
        began = time.perf_counter()
        measured[name] = tof.measure(sources[name], pose)[0]
        spent.append(time.perf_counter() - began)
    apart = np.abs(measured["camera"] - measured["rays"])
    compared.final_mm.append(1e3 * apart[judged & np.isfinite(apart)])


def _apart(rendered: Hits, cast: Hits, judged: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "m"]:
    """Difference of the judged ranges, m."""
    difference = np.abs(rendered.distance_m.astype(np.float64) - cast.distance_m)
    return np.asarray(difference.reshape(judged.shape)[judged])
