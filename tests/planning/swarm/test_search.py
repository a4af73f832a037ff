"""Swarm and exact search against the evaluation of every pixel."""

import functools
import math

import numpy as np
import pytest

from perception.monocular.back_projection import floor_points
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, Pose3, head_rotation
from perception.primitives.robot_model import DARWIN_OP
from planning.swarm import random_floors, search
from planning.swarm.objective import PRINTED, Objective, ObjectiveConfig
from planning.swarm.search import SwarmConfig

CAMERA = Camera.from_view(240, 240, math.pi / 2, math.pi / 2)
SEEDS = range(10)


def camera_on_body(pan_deg):
    return Pose3.from_rotation(
        head_rotation(math.radians(pan_deg), math.radians(30.0)), np.array([0.05, 0.0, 0.383])
    )


@functools.cache
def room(seed):
    """A random room, and stones in it that are narrower than the robot: one edge of its way passes on each side."""
    rng = np.random.default_rng([seed, 1])
    floor = random_floors.make(rng, CAMERA)
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width].astype(float)
    places = floor_points(np.stack([u, v], axis=-1), CAMERA, camera_on_body(0.0))
    for _ in range(2):
        stone = np.array([rng.uniform(0.4, 1.2), rng.uniform(-0.4, 0.4)])
        floor.movable[np.hypot(*(places - stone).transpose(2, 0, 1)) < 0.03] = False
    return floor


def objective(seed, config=None, pan_deg=0.0, sides=(False, False)):
    floor = room(seed)
    T = camera_on_body(pan_deg)
    return Objective.of(
        floor.movable, CAMERA, T, Pose2(), floor.goal, config or ObjectiveConfig(), sides
    )


def random_goal(seed):
    return room(seed).goal


class Looker:
    """A look at every pixel in NumPy, from rays cast at the floor; knows nothing of the compiled loops.

    `slack`: how much, px, m or rad, a thing must overlap before it counts; what is nearer is rounding.
    """

    def __init__(self, seed, config=None, pan_deg=0.0, sides=(False, False), slack=1e-6):
        floor = room(seed)
        self.config, self.slack, self.sides = config or ObjectiveConfig(), slack, sides
        self.blocked, self.goal = ~np.asarray(floor.movable, bool), floor.goal
        self.count = np.pad(np.cumsum(self.blocked, axis=1), ((0, 0), (1, 0)))
        self.T = camera_on_body(pan_deg)
        v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
        x, y = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
        rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ self.T.rotation.T
        down = (rays[..., 2] < 0.0) & (v >= self.config.top_share * CAMERA.height)
        along = self.T.position[2] / np.where(down, -rays[..., 2], np.nan)
        self.places = self.T.position[:2] + along[..., None] * rays[..., :2]
        axis = self.T.rotation[:2, 2] / np.linalg.norm(self.T.rotation[:2, 2])
        self.ahead = (self.places @ axis)[:, 0]  # of each row, along the camera's heading
        self.left = self.places @ [-axis[1], axis[0]]
        self.axis, self.u, self.v = axis, u, v
        self.half = DARWIN_OP.width_m / 2 + self.config.margin_m

    def column(self, rows, left):
        """Where a row shows the floor so far left, in fractions of a column."""
        first, second = self.left[rows, 0], self.left[rows, 1]
        return (first - left) / (first - second)

    def row(self, ahead):
        """Where the floor so far ahead shows; far below the picture if it is behind the camera."""
        points = ahead[..., None] * np.append(self.axis, 0.0)
        found = CAMERA.project(self.T.inverse().apply(points))[..., 1]
        return np.where(np.isfinite(found), found, 1e9)

    def any_blocked(self, rows, first, last):
        """Whether columns first to last of each row, as far as they are in the picture, are blocked anywhere."""
        first = np.clip(first, 0, CAMERA.width).astype(int)
        end = np.clip(last + 1, first, CAMERA.width).astype(int)
        return self.count[rows, end] > self.count[rows, first]

    def footprint(self):
        """p1."""
        e, config = self.slack, self.config
        deep = DARWIN_OP.depth_m / 2 + config.margin_m
        top = np.floor(self.row(self.ahead + deep) + 0.5 + e)
        bottom = np.floor(self.row(self.ahead - deep) + 0.5 - e)
        hidden = np.ones(self.blocked.shape, bool)
        for v in np.flatnonzero(np.isfinite(self.ahead)):
            if top[v] < 0 or bottom[v] >= CAMERA.height:
                continue
            u = np.arange(CAMERA.width)
            sides = self.left[v] + self.half, self.left[v] - self.half
            low = int(bottom[v])
            near = (self.ahead[v] - deep) * self.axis
            across = np.array([-self.axis[1], self.axis[0]])
            corners = [np.append(near, 0.0) + np.outer(side, [*across, 0.0]) for side in sides]
            begin, close = (CAMERA.project(self.T.inverse().apply(c))[:, 0] for c in corners)
            out = (begin < -0.5 - e) | (close > CAMERA.width - 0.5 + e)
            for y in range(int(top[v]), low + 1):
                begin = np.floor(self.column(y, sides[0]) + 0.5 + e)
                close = np.floor(self.column(y, sides[1]) + 0.5 - e)
                out |= self.any_blocked(np.full(len(u), y), begin, close)
            hidden[v] = out
        return hidden

    def way(self, pixels):
        """p2 of pixels (n, 2): both edges of the corridor and all between them, row by row of the picture."""
        u, v = pixels.T
        ahead, left = self.ahead[v], self.left[v, u]
        reach = np.hypot(ahead, left)
        tangent, sine, secant = left / ahead, left / reach, reach / ahead
        hidden = ahead < reach * math.cos(math.radians(80.0))
        e, last = self.slack, CAMERA.height - 1
        begins = [self.row(ahead - side * self.half * sine) for side in (1.0, -1.0)]
        near = self.row(ahead - self.half * np.abs(sine))
        for y in range(int(np.nanargmax(np.isfinite(self.ahead))), CAMERA.height):
            lines = []
            for side, begin in zip((1.0, -1.0), begins, strict=True):
                aside = side * self.half * secant
                line = self.column(y, self.ahead[y] * tangent + aside)
                steep = self.column(last, self.ahead[last] * tangent + aside)
                steep = steep - self.column(last - 1, self.ahead[last - 1] * tangent + aside)
                wide = 0.5 * np.abs(steep)
                touched = self.any_blocked(
                    np.full(len(u), y),
                    np.floor(line - wide + 0.5 + e),
                    np.floor(line + wide + 0.5 - e),
                )
                hidden |= touched & (y >= begin + e)
                lines.append(line)
            inner = np.floor(lines[0] + 0.5 + e), np.floor(lines[1] + 0.5 - e)
            hidden |= self.any_blocked(np.full(len(u), y), *inner) & (y >= near + e)
        return hidden

    def printed_way(self, pixels):
        """p2 as printed: a corridor from the two nearest pixels to a point."""
        hidden = np.zeros(len(pixels), bool)
        u, v = pixels.T
        e, last = self.slack, CAMERA.height - 1
        for side in (1.0, -1.0):
            near = self.column(last, side * self.half)
            steep = (near - u) / np.maximum(last - v, 1)
            for y in range(CAMERA.height):
                line, wide = u + steep * (y - v), 0.5 * np.abs(steep)
                touched = self.any_blocked(
                    np.full(len(u), y),
                    np.floor(line - wide + 0.5 + e),
                    np.floor(line + wide + 0.5 - e),
                )
                hidden |= touched & (y >= v) & (v < last)
        return hidden

    def cost(self):
        """Distance of each pixel's place to the goal, m; NaN above the horizon."""
        return np.hypot(*(self.places - self.goal).transpose(2, 0, 1))

    def penalties(self):
        """How many of p1, p3 and p4 each pixel violates, and which pixels see the floor ahead."""
        config, e = self.config, self.slack
        bearing = np.arctan2(self.places[..., 1], self.places[..., 0])
        if config.literal:  # measured from the y axis, and the robot looks along x
            bearing = bearing - math.pi / 2
        far = np.hypot(*self.places.transpose(2, 0, 1)) > config.farthest_m + e
        turned = (np.abs(bearing) > config.window_rad(DARWIN_OP.gait) + e) | far
        half = CAMERA.width / 2
        lost = ((self.u < half) & self.sides[0]) | ((self.u >= half) & self.sides[1])
        seen = np.isfinite(self.places[..., 0]) & (np.nan_to_num(self.ahead) > 0.0)[:, None]
        return 1 * self.footprint() + turned + lost, seen

    def free(self):
        """Which pixels nothing forbids."""
        penalties, seen = self.penalties()
        found = seen & (penalties == 0)
        found[found] = ~self.way(np.stack([self.u[found], self.v[found]], axis=1))
        return found

    def least(self):
        """The least cost of a pixel that nothing forbids, m; infinite if there is none. As printed: least sum."""
        if not self.config.literal:
            free = self.free()
            return float(self.cost()[free].min()) if free.any() else math.inf
        penalties, seen = self.penalties()
        ways = self.printed_way(np.stack([self.u[seen], self.v[seen]], axis=1))
        return float((self.cost()[seen] + penalties[seen] + ways).min())


@functools.cache
def bounds(*args):
    """The least value if every doubtful pixel is free, and if none is."""
    return Looker(*args).least(), Looker(*args, slack=-1e-6).least()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("pan", "sides"), [(0.0, (False, False)), (25.0, (False, True))])
def test_the_exact_search_equals_the_evaluation_of_every_pixel(seed, pan, sides):
    o = objective(seed, pan_deg=pan, sides=sides)
    low, high = bounds(seed, None, pan, sides)
    for found in (search.exact(o), search.brute_force(o)):
        value = math.inf if found is None else found.value
        assert low <= value + 1e-9
        assert value <= high + 1e-9
        if found is not None:
            assert np.linalg.norm(o.place(found.pixel) - random_goal(seed)) == pytest.approx(value)


@pytest.mark.parametrize("seed", [0, 5, 11, 17])
@pytest.mark.parametrize(("pan", "sides"), [(0.0, (False, False)), (-25.0, (True, False))])
def test_forbidden_pixels_agree_with_ray_casting(seed, pan, sides):
    o = objective(seed, pan_deg=pan, sides=sides)
    looks = [Looker(seed, None, pan, sides, slack) for slack in (1e-6, -1e-6)]
    pixels = np.stack([looks[0].u.ravel(), looks[0].v.ravel()], axis=1).astype(float)
    value = o.value(pixels).reshape(CAMERA.height, CAMERA.width)
    lenient, strict = (look.free() for look in looks)
    free = value < o.config.penalty
    assert not np.any(free & ~lenient)
    assert not np.any(strict & ~free)
    assert np.count_nonzero(lenient & ~strict) < 20
    np.testing.assert_allclose(value[free], looks[0].cost()[free], atol=1e-9)


def test_ray_casting_decides_almost_every_pixel():
    told = [bounds(seed, None, 0.0, (False, False)) for seed in SEEDS]
    assert np.mean([low == high for low, high in told]) >= 28 / 30
    assert np.mean([math.isfinite(low) for low, _ in told]) >= 20 / 30


@pytest.mark.parametrize("seed", range(6))
def test_the_printed_objective_is_searched_exactly_too(seed):
    found = search.exact(objective(seed, PRINTED))
    assert found is not None
    low, high = bounds(seed, PRINTED)
    assert low - 1e-9 <= found.value <= high + 1e-9


def test_a_picture_without_floor_has_no_best_pixel():
    T = Pose3.from_rotation(head_rotation(0.0, 0.5), np.array([0.0, 0.0, 0.4]))
    black = np.zeros((240, 240), np.uint8)
    o = Objective.of(black, CAMERA, T, Pose2(), np.array([2.0, 0.0]), ObjectiveConfig())
    assert search.exact(o) is None
    assert search.brute_force(o) is None
    for mode in search.MODES:
        assert search.find(o, SwarmConfig(mode), np.random.default_rng(0)) is None


def gaps(mode):
    found = []
    for seed in SEEDS:
        o = objective(seed)
        best = search.exact(o)
        if best is not None:
            flown = search.fly(o, SwarmConfig(mode), np.random.default_rng(seed))
            found.append(flown.value - best.value)
    return np.array(found)


@pytest.mark.parametrize("mode", ["two_pixel", "constriction", "spread"])
def test_a_stable_swarm_is_near_the_optimum_and_never_beyond(mode):
    gap = gaps(mode)
    assert gap.min() >= 0.0
    assert np.quantile(gap, 0.85) <= 0.05


def test_the_printed_inertia_misses_most_of_the_time():
    assert np.mean(gaps("literal") > 0.05) > 0.6


def test_the_printed_inertia_drives_the_swarm_to_the_border():
    """Mean dynamics x'' of w = 2, c1 + c2 = 4 have spectral radius 1.41, of constriction 0.85."""
    radius = {}
    for mode, (inertia, own, others, _) in search.MODES.items():
        pull = (own + others) / 2
        step = np.array([[1 + inertia - pull, -inertia], [1.0, 0.0]])
        radius[mode] = max(abs(np.linalg.eigvals(step)))
    assert radius["literal"] == pytest.approx(math.sqrt(2.0), abs=1e-6)
    assert radius["constriction"] < 0.9


def test_the_same_generator_gives_the_same_result():
    o = objective(1)
    first, again = (search.fly(o, SwarmConfig("spread"), np.random.default_rng(4)) for _ in "ab")
    assert first == again


def test_the_chosen_pixel_is_never_a_forbidden_one():
    for seed in SEEDS:
        o = objective(seed)
        for mode in ("exact", "spread", "literal"):
            found = search.find(o, SwarmConfig(mode), np.random.default_rng(seed))
            assert found is not None
            assert o.value(np.array([found.pixel], float))[0] < o.config.penalty


def test_an_unknown_mode_names_the_known_ones():
    with pytest.raises(ConfigError, match="'best' is unknown; choose exact, literal"):
        SwarmConfig("best")
