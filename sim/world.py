"""The world: a scene with a clock; pictures and ranges at the current time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3

from .movers.traffic import Traffic
from .rendering.numbered import NumberedScene
from .rendering.pictures import Pictures
from .rendering.rays import RayCaster
from .rendering.renderer import Renderer, choose_renderer
from .rendering.surfaces import RangeSource
from .scene import MovingState, Place, Scene
from .shapes import Solid

RANGE_SOURCES = ("camera", "rays")


class World:
    """Runs a scene. Use it as a context manager or close it: it holds a renderer.

    Args:
        scene: The scene.
        renderer: "egl", "tiny", or "auto" for EGL where it works.
        seed: Draws the phase of each moving object, unless the object sets its own, and what its law draws.
    """

    def __init__(self, scene: Scene, renderer: str = "auto", seed: int = 0) -> None:
        self.scene = scene
        self.stamp_s = 0.0
        self.renderer = choose_renderer(renderer)
        self._links: tuple[tuple[Solid, ...], ...] = ()
        self._link_poses: tuple[Pose3, ...] = ()
        self._traffic = Traffic(scene, seed)
        self._traffic.advance_to(0.0)
        self._caster: RayCaster | None = None
        self._client: Renderer | None = None
        self._pictures: Pictures | None = None
        self._numbered: NumberedScene | None = None

    def advance(self, seconds: float) -> None:
        """Advance the clock by a time.

        Raises:
            InputError: for a negative time.
        """
        if not seconds >= 0.0:
            raise InputError(f"world: cannot advance by {seconds} s; time only goes forward")
        self.advance_to(self.stamp_s + seconds)

    def advance_to(self, stamp_s: float, robot: Place | None = None) -> None:
        """Advance the clock to a stamp; exact for any number of calls.

        Args:
            stamp_s: Of the clock, s.
            robot: Where the robot is then, m, for movers that react to it.

        Raises:
            InputError: for a stamp in the past.
        """
        if not stamp_s >= self.stamp_s:
            raise InputError(f"world: cannot go back to {stamp_s} s from {self.stamp_s} s")
        self.stamp_s = stamp_s
        self._traffic.advance_to(stamp_s, robot)

    def moving_states(self) -> list[MovingState]:
        """(x, y, vx, vy) of every moving object, m and m/s."""
        return self._traffic.states(self.stamp_s)

    def body_states(self, after_s: float = 0.0) -> list[MovingState]:
        """The same of every piece of `Scene.moving_bodies`, now or after a time."""
        return self._traffic.body_states(self.stamp_s + after_s)

    def carry(self, links: Sequence[tuple[Solid, ...]]) -> None:
        """Add the links of a robot, each about its own frame; before the first picture."""
        self._links = tuple(links)

    def pose_links(self, poses: Sequence[Pose3]) -> None:
        """Where the links of the robot are now, world frame."""
        self._link_poses = tuple(poses)

    @property
    def carries(self) -> bool:
        """Whether the links of a robot are in it."""
        return bool(self._links)

    @property
    def rays(self) -> RayCaster:
        """Ray caster for the current time, built at the first call."""
        return self.rays_after(0.0)

    def rays_after(self, after_s: float) -> RayCaster:
        """The same caster with the moving objects where they are after a time."""
        if self._caster is None:
            self._caster = RayCaster(self.scene, self._links)
        self._caster.place(self._places(after_s), self._link_poses)
        return self._caster

    def ranges(self, source: str = "camera", after_s: float = 0.0) -> RangeSource:
        """What a time-of-flight camera meets, now or after a time.

        Args:
            source: One of `RANGE_SOURCES`: "camera" renders by PyBullet, "rays" casts rays.
            after_s: Time of the moving objects.
        """
        if source == "rays":
            return self.rays_after(after_s)
        if self._numbered is None:
            self._numbered = NumberedScene(self.scene, self._renderer(), self._links)
        self._numbered.place(self._places(after_s))
        self._numbered.pose_links(self._link_poses)
        return self._numbered

    def picture(
        self, camera: Camera, T_world_camera: Pose3, after_s: float = 0.0
    ) -> UInt8[np.ndarray, "h w 3"]:
        """Image of an ideal camera, now or after a time, red first."""
        return self._placed_pictures(after_s).colour(camera, T_world_camera)

    def rendered_depth(self, camera: Camera, T_world_camera: Pose3) -> Float32[np.ndarray, "h w"]:
        """Depth of the renderer along the optical axis, m: a check of its geometry, not a sensor."""
        return self._placed_pictures().depth(camera, T_world_camera)

    def _placed_pictures(self, after_s: float = 0.0) -> Pictures:
        if self._pictures is None:
            self._pictures = Pictures(self.scene, self._renderer(), self._links)
        self._pictures.place(self._places(after_s))
        self._pictures.pose_links(self._link_poses)
        return self._pictures

    def _places(self, after_s: float) -> list[tuple[float, float]]:
        return [(x, y) for x, y, _, _ in self.body_states(after_s)]

    def _renderer(self) -> Renderer:
        if self._client is None:
            self._client = Renderer(self.renderer)
        return self._client

    def close(self) -> None:
        """Close the renderer; a second call does nothing."""
        if self._client is not None:
            self._client.close()
            self._client = self._pictures = self._numbered = None

    def __enter__(self) -> World:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
