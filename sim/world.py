"""The world: a scene with a clock. Movers move, rays and pictures show the instant it is at.

Nothing here says what is true to anybody but the sensors; evaluation asks `truth`.
"""

from __future__ import annotations

from types import TracebackType

import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3

from .rendering.pictures import Pictures, choose_renderer
from .rendering.rays import RayCaster
from .scene import Scene


class World:
    """Plays a scene. Use it as a context, or close it: it holds a renderer.

    Args:
        scene: What stands and moves.
        renderer: "egl", "tiny", or "auto" for EGL where it works.
        seed: Of chance in the world: where on its line each moving_object is at the start, unless it says so itself.
    """

    def __init__(self, scene: Scene, renderer: str = "auto", seed: int = 0) -> None:
        self.scene = scene
        self.stamp_s = 0.0
        self.renderer = choose_renderer(renderer)
        rng = np.random.default_rng([seed, 20])
        drawn = [float(rng.uniform(0.0, 2.0 * m.reversal_s)) for m in scene.moving_objects]
        self._phases = [
            phase if moving_object.phase_s is None else moving_object.phase_s
            for phase, moving_object in zip(drawn, scene.moving_objects, strict=True)
        ]
        self._caster: RayCaster | None = None
        self._pictures: Pictures | None = None

    def advance(self, seconds: float) -> None:
        """Let time pass.

        Raises:
            InputError: for time going back.
        """
        if not seconds >= 0.0:
            raise InputError(f"world: cannot advance by {seconds} s; time only goes forward")
        self.advance_to(self.stamp_s + seconds)

    def advance_to(self, stamp_s: float) -> None:
        """Let time pass until a stamp; exact, however many advances it takes.

        Raises:
            InputError: for a stamp that is over.
        """
        if not stamp_s >= self.stamp_s:
            raise InputError(f"world: cannot go to {stamp_s} s; it is {self.stamp_s} s already")
        self.stamp_s = stamp_s

    def moving_states(self, after_s: float = 0.0) -> list[tuple[float, float, float, float]]:
        """(x, y, vx, vy) of every moving_object now, or so long after now, m and m/s."""
        pairs = zip(self.scene.moving_objects, self._phases, strict=True)
        return [
            moving_object.state(phase + (self.stamp_s + after_s)) for moving_object, phase in pairs
        ]

    @property
    def rays(self) -> RayCaster:
        """Rays through the world as it is now; built when first asked for."""
        return self.rays_after(0.0)

    def rays_after(self, after_s: float) -> RayCaster:
        """The same caster with the moving_objects where they are so long after now."""
        if self._caster is None:
            self._caster = RayCaster(self.scene)
        self._caster.place([(x, y) for x, y, _, _ in self.moving_states(after_s)])
        return self._caster

    def picture(
        self, camera: Camera, T_world_camera: Pose3, after_s: float = 0.0
    ) -> UInt8[np.ndarray, "h w 3"]:
        """What an ideal camera sees now, or so long after now, red first; the renderer starts when first asked."""
        return self._placed_pictures(after_s).colour(camera, T_world_camera)

    def rendered_depth(self, camera: Camera, T_world_camera: Pose3) -> Float32[np.ndarray, "h w"]:
        """The renderer's own depth along the axis, m: a check on its geometry, not a sensor."""
        return self._placed_pictures().depth(camera, T_world_camera)

    def _placed_pictures(self, after_s: float = 0.0) -> Pictures:
        if self._pictures is None:
            self._pictures = Pictures(self.scene, self.renderer)
        self._pictures.place([(x, y) for x, y, _, _ in self.moving_states(after_s)])
        return self._pictures

    def close(self) -> None:
        """Give the renderer back; a second time does nothing."""
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None

    def __enter__(self) -> World:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
