"""The ground round the robot as plane surfaces of several heights, fused from depth images.

Everything stands in a map frame that the motions of the body build up; what leaves is in the frame of the body, with the
covariance of its place relative to the body, to which every motion adds its error. Heights and slopes of all surfaces are one
Gaussian (`height_filter`); sides are fused one by one; the cells that were seen give the rest of the outline.

A region of an image and a surface are one if one plane explains both within their covariance and they touch, or nearly so.
Two treads never are: the riser between them is many times the standard deviation of a height.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose2, Pose3
from perception.terrain.region import Region

from . import sides as side_fusion
from .config import GroundConfig
from .height_filter import HeightFilter
from .lookup import corrected, labels_of, looked_up
from .measured import Level, Side, level, side
from .outline import believed, outlines
from .seen_cells import CELL_M, SeenCells, lattice
from .surface import Border, Surface

STEEPEST_RAD = math.radians(35.0)
"""Ours: no foot stands on steeper ground; as `inclination.RAMP_RAD`."""
GATE = 16.3  # chi-square, 3 degrees of freedom, 0.999
APART_M = (
    0.6  # ours: largest unseen gap within a surface, as from the feet to the first ground ahead
)
IN_COMMON = 0.1  # ours: share of a region's cells by which a surface is preferred to all others
VAGUE_M = 0.08  # ours: sides with a larger standard deviation are not used
COVERED = 0.5  # ours: two surfaces become one if one covers this share of the other's cells
LEAST_M2 = 0.01  # ours: least area of a new surface; a foot has 0.02
BEYOND_M, BEYOND_SIGMAS = (
    0.03,
    3.0,
)  # ours: a cell is removed if an image sees farther than it by both
STAND_RADIUS_M = 0.12  # ours: radius of the disc below the feet, half the width of a stance
STAND_APART_M = 0.3
"""Ours: largest distance from that disc to the surface to which it belongs; the camera does not see between."""


@dataclass(eq=False)
class _Patch:
    """A surface in the map frame, beside its height and slopes."""

    origin: Float[np.ndarray, "2"]
    cells: SeenCells = field(default_factory=SeenCells)
    sides: list[Side] = field(default_factory=list)
    views: int = 0
    place_m2: float = 0.0  # variance of its place across, for sides that are not straight


class GroundMap:
    """Surfaces that a foot may stand on, round the robot.

    At the start it is a small disc below the feet; nothing else is known.
    """

    def __init__(self, config: GroundConfig | None = None) -> None:
        """The robot stands on level ground."""
        self.config = config or GroundConfig()
        self._body = Pose2()  # in the map frame
        self._height_m = 0.0  # of the ground where it stands
        self._filter: HeightFilter | None = None
        self._patches: list[_Patch] = []

    def move(self, motion: Pose2, rise_m: float, covariance: Float[np.ndarray, "4 4"]) -> None:
        """Follow a motion of the body.

        Args:
            motion: New pose of the body in its previous frame.
            rise_m: By how much the ground where it stands is higher than before, by the joints.
            covariance: Of (x, y, yaw, rise), m and rad, in the previous frame.

        Raises:
            InputError: A value is not finite, or the covariance is no covariance.
        """
        _check("covariance of the motion", covariance)
        if not (np.isfinite(motion.vector).all() and math.isfinite(rise_m)):
            raise InputError(f"ground: motion {motion}, rise {rise_m} must be finite")
        turn = np.eye(4)
        turn[:2, :2] = self._body.rotation
        covariance = turn @ covariance @ turn.T
        self._body = self._body @ motion
        self._height_m += rise_m
        heights = self._heights()
        at = self._at
        effects = []
        for index, patch in enumerate(self._patches):
            slope = heights.mean[3 * index + 1 : 3 * index + 3]
            # An error (x, y, yaw) of the body moves a surface by (-x, -y, -yaw) as it sees it.
            lever = patch.origin - at
            effect = np.zeros((3, 4))
            effect[0] = [*slope, slope @ np.array([-lever[1], lever[0]]), -1.0]
            effect[1:, 2] = slope[1], -slope[0]
            effects.append(effect)
            patch.sides = [side_fusion.moved(one, at, covariance[:3, :3]) for one in patch.sides]
            patch.place_m2 += (covariance[0, 0] + covariance[1, 1]) / 2.0
            patch.place_m2 += covariance[2, 2] * float(lever @ lever) / 2.0
        heights.moved(np.concatenate(effects), covariance)
        self._stand(heights)
        self._forget()

    def observe(
        self,
        regions: Sequence[Region],
        T_body_camera: Pose3,
        covariance: Float[np.ndarray, "6 6"],
        camera: Camera,
    ) -> Pose3:
        """Fuse the regions of one depth image.

        Args:
            regions: From `perception.terrain.segmentation.find`.
            T_body_camera: Pose of the camera; z = 0 is the ground where the robot stands.
            covariance: Of that pose: translation (m), then rotation (rad) about the camera, both along the axes
                of the body: the true camera is at t + d, turned by R_w R. For the floor prior of the joints
                (`PriorConfig`) that is diag(p, p, h, a, a, y) squared, with h `joints_height_m`, a `joints_tilt_deg`, and
                p and y as the sway of the trunk has them.
            camera: Of the image.

        Returns:
            T_body_camera, levelled by what the map knew of the surfaces that were seen.

        Raises:
            InputError: The covariance is none, a region lies outside of the image, or the regions are of a sensor
                with another number of coefficients of distortion than those before.
        """
        _check("covariance of the camera's pose", covariance)
        if not regions:
            return T_body_camera
        labels = labels_of(regions, camera)
        heights = self._heights(regions[0].shared.shape[1])
        turn = np.kron(np.eye(2), np.pad(self._body.rotation, (0, 1)))
        turn[2, 2] = turn[5, 5] = 1.0
        covariance = turn @ covariance @ turn.T
        share = self.config.lasting_share
        lasting = math.sqrt(share) * _root(covariance)
        heights.begin_view((1.0 - share) * covariance, lasting)
        T = self._lifted @ T_body_camera
        # The largest first: it tells best how high the camera is, and so which surfaces the others are.
        order = sorted(range(len(regions)), key=lambda k: -len(regions[k].pixels))
        of_region: dict[int, _Patch] = {}
        seen: dict[int, Float[np.ndarray, "n 2"]] = {}
        for number in order:
            now = corrected(T, heights.camera)
            region = regions[number]
            facing = now.rotation @ region.plane.normal
            if facing[2] < math.cos(STEEPEST_RAD):
                continue
            points = self._cells_of(number, region, labels, now, camera)
            if len(points) * CELL_M**2 < LEAST_M2:
                continue
            seen[number] = points
            patch = self._matched(region, points, T, heights)
            if patch is None:
                patch = _Patch(now.apply(region.middle)[:2])
                self._patches.append(patch)
                heights.add(level(region, T, patch.origin))
            of_region[number] = patch
        now = corrected(T, heights.camera)
        single, lasting, bend = heights.camera_error()
        self._clear(regions, labels, now, camera, heights)
        for number, patch in of_region.items():
            patch.cells.add(seen[number])
            patch.place_m2 = float(np.trace(single[:2, :2]) + np.sum(lasting[:2] ** 2)) / 2.0
            patch.views += 1
            region = regions[number]
            for edge in region.edges:
                one = side(region, edge, now, single, lasting, bend)
                if one.variance_at(0.0) < VAGUE_M**2:
                    side_fusion.fuse(patch.sides, one)
            patch.sides = believed(patch.cells, patch.sides)
        self._join(list(of_region.values()), heights)
        self._forget()
        return self._lifted.inverse() @ now

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """In the body frame; the one below the feet first if there is one, then by distance."""
        heights = self._heights()
        to_body = self._body.inverse()
        found: list[tuple[float, Surface]] = []
        for index, patch in enumerate(self._patches):
            for outline in outlines(patch.cells, patch.sides, self._at):
                turn = np.eye(3)
                turn[1:, 1:] = to_body.rotation
                height = turn @ heights.mean[3 * index : 3 * index + 3]
                height[0] -= self._height_m
                borders, sigma = _borders(patch, outline.corners, outline.sides)
                surface = Surface(
                    to_body.apply(patch.origin),
                    height,
                    turn @ heights.covariance(index) @ turn.T,
                    to_body.apply(outline.corners),
                    borders,
                    sigma,
                    max((one.shared_m for one in patch.sides), default=0.0),
                    patch.views,
                )
                below = bool(surface.contains(np.zeros(2)))
                away = float(np.linalg.norm(surface.outline, axis=1).min())
                found.append((-1.0 if below else away, surface))
        return tuple(one for _, one in sorted(found, key=lambda rated: rated[0]))

    @property
    def _at(self) -> Float[np.ndarray, "2"]:
        """(x, y) of the body in the map frame."""
        return np.array([self._body.x, self._body.y])

    @property
    def _lifted(self) -> Pose3:
        """The body in the map frame, in space."""
        flat = self._body.lifted()
        return replace(flat, translation=(self._body.x, self._body.y, self._height_m))

    def _heights(self, coefficients: int | None = None) -> HeightFilter:
        """The filter, which begins with the ground below the feet; the first image tells the coefficients."""
        if self._filter is None:
            self._filter = HeightFilter(None)
            self._add_stand(self._filter, self.config.start_m)
        if coefficients is not None and not self._filter.takes(coefficients):
            raise InputError(
                f"ground: the regions have {coefficients} coefficients of distortion, those before had "
                f"{self._filter.coefficients}; a map takes the images of one sensor, keep another map for the other"
            )
        return self._filter

    def _stand(self, heights: HeightFilter) -> None:
        """The surface below the feet has the height 0; if none has, nearly, they stand on a new one."""
        near = [
            (patch.cells.away_from(self._at), index) for index, patch in enumerate(self._patches)
        ]
        for away, index in sorted(near):
            patch = self._patches[index]
            if away < STAND_APART_M and heights.pin(
                index, self._at - patch.origin, self._height_m, self.config.stand_sigma_m
            ):
                self._below(patch)
                return
        self._add_stand(heights)

    def _add_stand(self, heights: HeightFilter, radius_m: float = STAND_RADIUS_M) -> None:
        """A new surface below the feet."""
        tilt = math.radians(self.config.stand_tilt_deg)
        sigma = np.array([self.config.stand_sigma_m, tilt, tilt])
        heights.add_known(np.array([self._height_m, 0.0, 0.0]), np.diag(sigma**2))
        self._patches.append(_Patch(self._at))
        self._below(self._patches[-1], radius_m)

    def _below(self, patch: _Patch, radius_m: float = STAND_RADIUS_M) -> None:
        """See the cells below the feet, as far as they are within the sides and of no other surface."""
        points = lattice(self._at - radius_m, self._at + radius_m)
        kept = np.linalg.norm(points - self._at, axis=1) < radius_m
        for one in patch.sides:
            kept &= one.across(points) < 0.0
        for other in self._patches:
            kept &= ~other.cells.holds(points)
        patch.cells.add(points[kept])

    def _cells_of(
        self,
        number: int,
        region: Region,
        labels: Int[np.ndarray, "h w"],
        T: Pose3,
        camera: Camera,
    ) -> Float[np.ndarray, "n 2"]:
        """Cells that a region covers, within reach."""
        corners = T.apply(region.outline)[:, :2]
        reach = self.config.reach_m
        low = np.maximum(corners.min(axis=0), self._at - reach)
        high = np.minimum(corners.max(axis=0), self._at + reach)
        if (low >= high).any():
            return np.zeros((0, 2))
        points = lattice(low, high)
        points = points[np.linalg.norm(points - self._at, axis=1) < reach]
        found = level(region, T, self._at)
        z = found.value[0] + (points - self._at) @ found.value[1:]
        label, _ = looked_up(labels, points, z, T, camera)
        return points[label == number]

    def _matched(
        self, region: Region, points: Float[np.ndarray, "n 2"], T: Pose3, heights: HeightFilter
    ) -> _Patch | None:
        """The surface that a region is part of, with the region's height fused; None if it is a new one."""
        best: tuple[tuple[float, float], int, Level] | None = None
        for index, patch in enumerate(self._patches):
            one = level(region, T, patch.origin)
            distance, volume = heights.distance(index, one)
            if distance > GATE or not patch.cells.is_near(points, APART_M):
                continue
            common = float(patch.cells.holds(points).mean())
            cost = (-common if common > IN_COMMON else 0.0, distance + volume)
            if best is None or cost < best[0]:
                best = cost, index, one
        if best is None:
            return None
        heights.update(best[1], best[2])
        return self._patches[best[1]]

    def _clear(
        self,
        regions: Sequence[Region],
        labels: Int[np.ndarray, "h w"],
        T: Pose3,
        camera: Camera,
        heights: HeightFilter,
    ) -> None:
        """Remove cells through which the image saw something farther."""
        inverse = np.stack([-one.plane.normal / one.plane.offset_m for one in regions])
        for index, patch in enumerate(self._patches):
            points = patch.cells.places()
            away = points - patch.origin
            mean, P = heights.mean[3 * index : 3 * index + 3], heights.covariance(index)
            z = mean[0] + away @ mean[1:]
            label, seen = looked_up(labels, points, z, T, camera)
            known = label >= 0
            q = np.einsum("ij,ij->i", inverse[label[known]], seen[known] / seen[known, 2:])
            depth = seen[known, 2]
            sigma = math.sqrt(float(P[0, 0])) * depth / max(float(T.position[2]), 0.1)
            farther = 1.0 / np.maximum(q, 1e-6) - depth
            patch.cells.take(
                points[known][farther > BEYOND_M + BEYOND_SIGMAS * sigma + 0.02 * depth]
            )

    def _join(self, seen: list[_Patch], heights: HeightFilter) -> None:
        """Join surfaces that overlap at the same height."""
        for patch in seen:
            for other in [one for one in self._patches if one is not patch]:
                if patch not in self._patches or other not in self._patches:
                    continue
                if other.cells.is_empty or not patch.cells.meets(other.cells):
                    continue
                if patch.cells.holds(other.cells.places()).mean() < COVERED:
                    continue
                one, two = self._index(patch), self._index(other)
                apart = patch.origin - other.origin
                if heights.equal(one, two, apart)[0] > GATE:
                    continue
                heights.join(one, two, apart)
                patch.cells.unite(other.cells)
                for old in other.sides:
                    side_fusion.fuse(patch.sides, old)
                patch.sides = believed(patch.cells, patch.sides)
                patch.views = max(patch.views, other.views)
                del self._patches[two]

    def _index(self, patch: _Patch) -> int:
        return next(k for k, one in enumerate(self._patches) if one is patch)

    def _forget(self) -> None:
        """Drop what is empty, and what is far away or behind."""
        heights = self._heights()
        ahead = self._body.rotation[:, 0]
        for index in reversed(range(len(self._patches))):
            patch = self._patches[index]
            if self.config.forgets:
                away = patch.cells.places() - self._at
                near = np.linalg.norm(away, axis=1) < self.config.reach_m
                near &= away @ ahead > -self.config.behind_m
                if not near.all() or not len(near):
                    patch.cells.keep(near)
            if patch.cells.is_empty:
                heights.remove(index)
                del self._patches[index]


def _borders(
    patch: _Patch, corners: Float[np.ndarray, "n 2"], sides: Int[np.ndarray, "n"]
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """What is beyond each side of a polygon, and its standard deviation across."""
    borders = np.full(len(corners), int(Border.UNSEEN))
    sigma = np.full(len(corners), math.sqrt(CELL_M**2 + patch.place_m2))
    ends = np.roll(corners, -1, axis=0)
    for k, number in enumerate(sides):
        if number >= 0:
            one = patch.sides[number]
            borders[k] = one.border
            low, high = (float(run) for run in one.run(np.stack([corners[k], ends[k]])))
            middle = one.variance_at((low + high) / 2.0)  # Simpson's rule for the mean along it
            total = one.variance_at(low) + 4.0 * middle + one.variance_at(high)
            sigma[k] = math.sqrt(total / 6.0)
    return borders, sigma


def _check(name: str, covariance: np.ndarray) -> None:
    if not np.isfinite(covariance).all() or float(np.linalg.eigvalsh(covariance)[0]) < -1e-9:
        raise InputError(
            f"ground: the {name} must be finite, symmetric and without negative eigenvalues"
        )


def _root(covariance: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """Matrix whose product with its transpose is a covariance; it may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
