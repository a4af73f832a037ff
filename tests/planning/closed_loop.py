"""A small room in two dimensions, to walk route, field, footsteps, guard and gaze in a closed loop.

Furniture, standing posts and blind movers that go to and fro; a depth camera of 52 degrees on a panning
head, in two frames a step; a pose that is a few centimetres wrong; a Kalman filter per post. It is no
replacement for the simulation, but hundreds of runs take minutes. Run as a script to get the figures:

    python tests/planning/closed_loop.py FIRST_SEED LAST_SEED
"""

from __future__ import annotations

import dataclasses
import math
import sys
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy import ndimage

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, wrap_angle
from planning import guard
from planning.footsteps import footstep
from planning.gaze.sweep import Sweep, SweepConfig
from planning.route import Route, RouteConfig
from planning.search.potential import SearchConfig
from planning.univector import fields

ROOM = (6.0, 5.0)
CELL_M = 0.05
SIDE = 71
BODY_M = 0.15  # contact with a mover, seed 001
SOLID_M = 0.12  # contact with furniture: the body itself, shoulders included
POST_M = 0.10
HALF_STEP_S = 0.325
TIME_LIMIT_S = 300.0


@dataclass
class World:
    """Boxes (x0, y0, x1, y1), standing posts (x, y), and movers (x, y, vx, vy, period, phase)."""

    boxes: np.ndarray
    posts: np.ndarray
    movers: np.ndarray
    start: Pose2
    goal: np.ndarray

    def movers_at(self, stamp_s: float) -> np.ndarray:
        """Places (m, 2): to and fro between the two ends of each line, all the time."""
        period, phase = self.movers[:, 4], self.movers[:, 5]
        swing = np.abs((stamp_s + phase) % (2 * period) - period)  # period .. 0 .. period
        return self.movers[:, :2] + self.movers[:, 2:4] * swing[:, None]


def box_distance(boxes: np.ndarray, xy: np.ndarray) -> float:
    gap = np.maximum(np.maximum(boxes[:, :2] - xy, xy - boxes[:, 2:]), 0.0)
    return float(np.hypot(gap[:, 0], gap[:, 1]).min())


def make_world(
    rng: np.random.Generator, movers: int, speeds: tuple[float, float], reach_m: float = 0.28
) -> World:
    """A room whose start and goal are 4 m apart at least, with movers across or along the way.

    Wherever a mover is, a disc of radius `reach_m` can pass it.
    """
    w, h = ROOM
    while True:
        start = np.array([rng.uniform(0.5, 1.0), rng.uniform(0.5, h - 0.5)])
        goal = np.array([rng.uniform(w - 1.2, w - 0.5), rng.uniform(0.5, h - 0.5)])
        solid, posts = _furniture(rng, start, goal)
        gaps = _gaps(solid, posts)
        if not _passable(gaps, start, goal, reach_m):
            continue
        lines: list[list[float]] = []
        for _ in range(120):
            if len(lines) >= movers:
                break
            line = _line(rng, start, goal, speeds)
            if _keeps_clear(line, lines, gaps, start, goal, reach_m):
                lines.append(line)
        if len(lines) >= movers:
            yaw = math.atan2(*(goal - start)[::-1]) + rng.normal(0, 0.5)
            return World(solid, posts, np.array(lines), Pose2(*start, wrap_angle(yaw)), goal)


def _furniture(
    rng: np.random.Generator, start: np.ndarray, goal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    w, h = ROOM
    boxes = [(-0.1, -0.1, 0, h + 0.1), (w, -0.1, w + 0.1, h + 0.1)]
    boxes += [(-0.1, -0.1, w + 0.1, 0), (-0.1, h, w + 0.1, h + 0.1)]
    posts: list[np.ndarray] = []
    while len(boxes) < 4 + 7:
        size = rng.uniform(0.25, 0.9, 2)
        x, y = rng.uniform(0, w - size[0]), rng.uniform(0, h - size[1])
        box = np.array([[x, y, x + size[0], y + size[1]]])
        if min(box_distance(box, start), box_distance(box, goal)) > 0.5:
            boxes.append(tuple(box[0]))
    while len(posts) < 3:
        post = rng.uniform(0.05, 0.95, 2) * (w, h)
        apart = min(np.hypot(*(post - start)), np.hypot(*(post - goal)))
        if apart > 0.7 and box_distance(np.array(boxes), post) > 0.12:
            posts.append(post)
    return np.array(boxes), np.array(posts)


def _line(
    rng: np.random.Generator, start: np.ndarray, goal: np.ndarray, speeds: tuple[float, float]
) -> list[float]:
    middle = start + rng.uniform(0.2, 0.85) * (goal - start) + rng.normal(0, 0.4, 2)
    heading, speed, period = (
        rng.uniform(0, 2 * np.pi),
        rng.uniform(*speeds),
        rng.uniform(15.0, 25.0),
    )
    v = speed * np.array([math.cos(heading), math.sin(heading)])
    return [*(middle - v * period / 2), *v, period, rng.uniform(0, 2 * period)]


def _along(line: list[float]) -> np.ndarray:
    return np.array(line[:2]) + np.outer(np.linspace(0, line[4], 8), line[2:4])


def _keeps_clear(
    line: list[float],
    others: list[list[float]],
    gaps: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    reach_m: float,
) -> bool:
    places = _along(line)
    if np.any(places < 0.2) or np.any(places > np.array(ROOM) - 0.2):
        return False
    if min(gaps[int(y / 0.1), int(x / 0.1)] for x, y in places) < POST_M + 0.10:
        return False
    if np.hypot(*(places - start).T).min() < 0.9 or np.hypot(*(places - goal).T).min() < 0.55:
        return False
    for other in others:
        if np.hypot(*(places[:, None] - _along(other)).transpose(2, 0, 1)).min() < 0.6:
            return False
    xs, ys = np.arange(0.05, ROOM[0], 0.1), np.arange(0.05, ROOM[1], 0.1)
    for x, y in places[::2]:
        stood = np.hypot(xs[None] - x, ys[:, None] - y) - POST_M
        if not _passable(np.minimum(gaps, stood), start, goal, reach_m):
            return False
    return True


def _gaps(solid: np.ndarray, posts: np.ndarray) -> np.ndarray:
    """Distance to what stands, at 10 cm."""
    xs, ys = np.arange(0.05, ROOM[0], 0.1), np.arange(0.05, ROOM[1], 0.1)
    gaps = np.array([[box_distance(solid, np.array([x, y])) for x in xs] for y in ys])
    for post in posts:
        gaps = np.minimum(gaps, np.hypot(xs[None] - post[0], ys[:, None] - post[1]) - POST_M)
    return gaps


def _passable(gaps: np.ndarray, start: np.ndarray, goal: np.ndarray, reach_m: float) -> bool:
    """Whether a disc can get from start to goal."""
    regions, _ = ndimage.label(gaps >= reach_m)
    a, b = (regions[int(p[1] / 0.1), int(p[0] / 0.1)] for p in (start, goal))
    return bool(a == b > 0)


@njit
def cast(
    x: float, y: float, angles: np.ndarray, boxes: np.ndarray, discs: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Distance along each ray to the first surface, and which: -1 none, -2 a box, else the disc."""
    distances = np.full(len(angles), reach)
    what = np.full(len(angles), -1)
    for i in range(len(angles)):
        ux, uy = math.cos(angles[i]), math.sin(angles[i])
        for b in range(len(boxes)):
            near, far = 0.0, distances[i]
            for axis in range(2):
                p, u = (x, ux) if axis == 0 else (y, uy)
                lo, hi = boxes[b, axis], boxes[b, axis + 2]
                if abs(u) < 1e-12:
                    if p < lo or p > hi:
                        near, far = 1.0, 0.0
                    continue
                t0, t1 = (lo - p) / u, (hi - p) / u
                near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
            if near < far and near > 0.0:
                distances[i], what[i] = near, -2
        for d in range(len(discs)):
            px, py = discs[d, 0] - x, discs[d, 1] - y
            along, across = px * ux + py * uy, px * uy - py * ux
            if along > 0.0 and abs(across) < discs[d, 2]:
                t = along - math.sqrt(discs[d, 2] ** 2 - across**2)
                if 0.0 < t < distances[i]:
                    distances[i], what[i] = t, d
    return distances, what


@njit
def mark(
    evidence: np.ndarray,
    x: float,
    y: float,
    angles: np.ndarray,
    distances: np.ndarray,
    hit: np.ndarray,
    floor_reach: float,
) -> None:
    """Per cell of this frame: 1 floor seen, 2 obstacle seen; world grid whose corner is (-0.5, -0.5)."""
    for i in range(len(angles)):
        ux, uy = math.cos(angles[i]), math.sin(angles[i])
        t = 0.35
        while t < min(distances[i] - 0.03, floor_reach):
            c, r = int((x + t * ux + 0.5) / 0.05), int((y + t * uy + 0.5) / 0.05)
            if evidence[r, c] == 0:
                evidence[r, c] = 1
            t += 0.02
        if hit[i] != -1:
            d = distances[i]
            c, r = int((x + d * ux + 0.5) / 0.05), int((y + d * uy + 0.5) / 0.05)
            evidence[r, c] = 2 if hit[i] == -2 else 3


@dataclass
class Track:
    mean: np.ndarray
    P: np.ndarray
    since_s: float
    seen_s: float
    moving: float = 0.1


@dataclass
class Memory:
    """What the robot believes: its map and its tracks."""

    rng: np.random.Generator
    log_odds: np.ndarray = dataclasses.field(default_factory=lambda: np.full((120, 140), np.inf))
    mover_s: np.ndarray = dataclasses.field(default_factory=lambda: np.full((120, 140), -np.inf))
    tracks: dict[int, Track] = dataclasses.field(default_factory=dict)

    def see(
        self, world: World, true: Pose2, believed: Pose2, pan: float, stamp_s: float, dt: float
    ) -> None:
        for track in self.tracks.values():
            F = np.eye(4)
            F[0, 2] = F[1, 3] = dt
            G = np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])
            track.mean, track.P = F @ track.mean, F @ track.P @ F.T + 0.02**2 * G @ G.T
        bearings = pan + np.radians(np.arange(-26.0, 26.1, 0.5))
        posts = np.vstack([world.posts, world.movers_at(stamp_s)])
        discs = np.column_stack([posts, np.full(len(posts), POST_M)])
        distances, what = cast(true.x, true.y, true.yaw + bearings, world.boxes, discs, 3.0)
        noisy = distances + self.rng.normal(0, 0.01, len(distances)) * distances
        evidence = np.zeros(self.log_odds.shape, np.int64)
        mark(evidence, believed.x, believed.y, believed.yaw + bearings, noisy, what, 2.1)
        delta = np.where(evidence >= 2, 1.73, -0.85)
        first = np.isinf(self.log_odds)
        stood = ~first & (self.log_odds > 0.0) & (self.mover_s == -np.inf)
        self.log_odds = np.where(
            evidence > 0,
            np.clip(np.where(first, 0.0, self.log_odds) + delta, -3.9, 3.9),
            self.log_odds,
        )
        for d in range(len(posts)):
            if np.count_nonzero(what == d) >= 3:
                self._detect(d, true, believed, posts[d], stamp_s)
        moving = {d for d, t in self.tracks.items() if t.moving > 0.5}
        if evidence.max() >= 3:
            near = np.zeros(evidence.shape, bool)
            for d in moving:
                c, r = ((self.tracks[d].mean[:2] + 0.5) / CELL_M).astype(int)
                near[max(r - 4, 0) : r + 5, max(c - 4, 0) : c + 5] = True
            self.mover_s[(evidence == 3) & near & ~stood] = stamp_s
        self.mover_s[evidence == 2] = -np.inf
        old = (self.mover_s > -np.inf) & (self.mover_s < stamp_s - 10.0)
        self.log_odds[old] = np.inf
        self.mover_s[old] = -np.inf

    def _detect(
        self, d: int, true: Pose2, believed: Pose2, place: np.ndarray, stamp_s: float
    ) -> None:
        relative = true.rotation.T @ (place - (true.x, true.y))
        z = believed.apply(relative) + self.rng.normal(0, 0.02, 2)
        R = np.eye(2) * 0.03**2
        if d not in self.tracks:
            P = np.diag([0.03**2, 0.03**2, 0.06**2, 0.06**2])
            self.tracks[d] = Track(np.array([*z, 0.0, 0.0]), P, stamp_s, stamp_s)
            return
        track = self.tracks[d]
        S = track.P[:2, :2] + R
        difference = z - track.mean[:2]
        if difference @ np.linalg.solve(S, difference) > 16.0:  # it turned back unseen
            track.P = track.P + np.diag([0.05**2, 0.05**2, 0.06**2, 0.06**2])
            S = track.P[:2, :2] + R
        K = track.P[:, :2] @ np.linalg.inv(S)
        track.mean = track.mean + K @ difference
        track.P = track.P - K @ S @ K.T
        track.seen_s = stamp_s
        track.moving = max(moving_probability(track), 0.96 * track.moving)  # a pause is no rest

    def obstacles(self) -> list[Obstacle]:
        return [
            Obstacle(
                Gaussian(t.mean.copy(), t.P.copy()), POST_M, 0.4, d, t.moving, t.seen_s, t.since_s
            )
            for d, t in sorted(self.tracks.items())
        ]

    def window(self, here: np.ndarray, soft: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Probability, unknown and origin of the 71 x 71 cells round the robot; movers no more than soft."""
        c, r = np.floor((here + 0.5) / CELL_M).astype(int) - SIDE // 2
        wide = np.pad(self.log_odds, SIDE, constant_values=np.inf)
        part = wide[r + SIDE : r + 2 * SIDE, c + SIDE : c + 2 * SIDE]
        unknown = np.isinf(part)
        probability = np.where(unknown, 1.0, 1 / (1 + np.exp(-np.where(unknown, 0, part))))
        moving = np.pad(self.mover_s > -np.inf, SIDE)[
            r + SIDE : r + 2 * SIDE, c + SIDE : c + 2 * SIDE
        ]
        probability = np.where(moving & ~unknown, np.minimum(probability, soft), probability)
        return probability, unknown, np.array([c, r]) * CELL_M - 0.5

    def start_at(self, here: np.ndarray) -> None:
        """Where the robot stands nothing else does."""
        rows, columns = np.indices(self.log_odds.shape)
        x, y = (columns + 0.5) * CELL_M - 0.5, (rows + 0.5) * CELL_M - 0.5
        self.log_odds[np.hypot(x - here[0], y - here[1]) < 0.35] = -0.85

    def occupied(self, with_unseen: bool) -> np.ndarray:
        """Middles of the cells of what stands, and of those never seen: nobody walks there unseeing."""
        solid = np.isfinite(self.log_odds) & (self.log_odds > 0.0) & (self.mover_s == -np.inf)
        if with_unseen:
            solid |= np.isinf(self.log_odds)
        return (np.argwhere(solid)[:, ::-1] + 0.5) * CELL_M - 0.5


def moving_probability(track: Track) -> float:
    speed = float(np.hypot(*track.mean[2:]))
    sigma = math.sqrt(float(np.trace(track.P[2:, 2:])) / 2)
    return 1 / (1 + math.exp(-2.0 * (speed / max(sigma, 0.01) - 1.5))) if speed > 0.008 else 0.05


@dataclass(frozen=True)
class Settings:
    search: SearchConfig = dataclasses.field(default_factory=SearchConfig)
    route: RouteConfig = dataclasses.field(default_factory=RouteConfig)
    field: fields.FieldConfig = dataclasses.field(default_factory=fields.FieldConfig)
    guard: guard.GuardConfig = dataclasses.field(default_factory=guard.GuardConfig)
    sweep: SweepConfig = dataclasses.field(default_factory=SweepConfig)
    movers: int = 3
    speeds: tuple[float, float] = (0.03, 0.06)
    reach_m: float = 0.28  # radius of a disc that can pass every mover
    soft_movers: float = 0.4  # movers in the map are dear, not solid
    unseen_blocks: bool = True  # the guard takes cells never seen for occupied ones
    use_guard: bool = True


@dataclass
class Result:
    contacts: list[tuple[float, str]]
    arrived: bool
    time_s: float
    clearance_m: float  # to movers
    wall_m: float  # to what stands
    guarded: int  # steps the guard changed
    trace: list[tuple[float, ...]]
    unseen_s: list[float]


def walk(seed: int, settings: Settings) -> Result:
    """One run from start to goal."""
    rng = np.random.default_rng([seed, 7])
    world = make_world(rng, settings.movers, settings.speeds, settings.reach_m)
    gait = settings.guard.gait
    memory = Memory(rng)
    route, sweep = Route(settings.search, settings.route), Sweep(settings.sweep)
    true, error = world.start, np.zeros(3)
    result = Result([], False, 0.0, np.inf, np.inf, 0, [], [])
    touching: set[str] = set()
    stamp, pan = 0.0, 0.0
    deviation = np.array([0.02, 0.02, math.radians(1.0)])
    memory.start_at(np.array([true.x, true.y]))
    memory.see(world, true, true, 0.0, 0.0, 0.0)
    while stamp < TIME_LIMIT_S:
        believed = Pose2(true.x + error[0], true.y + error[1], wrap_angle(true.yaw + error[2]))
        here = np.array([believed.x, believed.y])
        if np.hypot(*(here - world.goal)) < 0.15:
            result.arrived = True
            break
        obstacles = memory.obstacles()
        via = route.update(*memory.window(here, settings.soft_movers), CELL_M, believed, world.goal)
        command, desired = gait.command(0.0, 0.0, 0.0), None
        if not sweep.surveying:
            wish = _heading(here, via, obstacles, settings.field)
            speed = gait.cruise_mps if route.path is not None else 0.0
            desired = footstep(wish, speed, believed, gait)
            command = desired
            if settings.use_guard:
                belief = Gaussian(believed.vector, np.diag(deviation**2))
                command = guard.choose(
                    desired,
                    belief,
                    obstacles,
                    memory.occupied(settings.unseen_blocks),
                    via,
                    settings.guard,
                    stamp,
                )
                result.guarded += command != desired
        gaze = sweep.next(stamp, believed, via, obstacles)
        result.trace.append((stamp, true.x, true.y, true.yaw, *via, pan, command != desired))
        pan = gaze.pan_rad
        half = Pose2(command.forward_m / 2, command.lateral_m / 2, 0.0)
        for part in range(2):
            slip = rng.normal(0, [0.002, 0.002, 0.005])
            turn = command.turn_rad if part else 0.0
            true = true @ Pose2(half.x + slip[0], half.y + slip[1], turn + slip[2])
            stamp += HALF_STEP_S
            keep = math.exp(-HALF_STEP_S / 5.0)
            error = keep * error + math.sqrt(1 - keep**2) * rng.normal(0, deviation)
            believed = Pose2(true.x + error[0], true.y + error[1], true.yaw + error[2])
            memory.see(world, true, believed, pan, stamp, HALF_STEP_S)
            _count(world, true, stamp, memory, touching, result)
    result.time_s = stamp
    return result


def _heading(
    here: np.ndarray, via: np.ndarray, obstacles: list[Obstacle], config: fields.FieldConfig
) -> float:
    movers = [o for o in obstacles if o.moving > 0.3]
    centres = np.array([o.position for o in movers]).reshape(-1, 2)
    speeds = np.array([float(np.hypot(*o.velocity)) for o in movers])
    radii = np.array([o.radius_m for o in movers])
    extended = fields.extended_radius(radii, speeds, np.zeros(len(movers)), config)
    u = fields.total(here[None], via, None, centres, extended, config)[0]
    return math.atan2(u[1], u[0])


def _count(
    world: World, true: Pose2, stamp: float, memory: Memory, touching: set[str], result: Result
) -> None:
    """Every contact once, from its beginning to its end."""
    here = np.array([true.x, true.y])
    gaps = {"wall": box_distance(world.boxes, here) - SOLID_M}
    for i, post in enumerate(world.posts):
        gaps[f"post {i}"] = float(np.hypot(*(post - here))) - POST_M - SOLID_M
    standing = min(gaps.values())
    for i, place in enumerate(world.movers_at(stamp)):
        gaps[f"mover {i}"] = float(np.hypot(*(place - here))) - POST_M - BODY_M
        result.clearance_m = min(result.clearance_m, gaps[f"mover {i}"])
    result.wall_m = min(result.wall_m, standing)
    for name, gap in gaps.items():
        if gap < 0.0 and name not in touching:
            touching.add(name)
            track = memory.tracks.get(len(world.posts) + int(name[-1])) if "mover" in name else None
            result.contacts.append((stamp, name))
            result.unseen_s.append(math.inf if track is None else stamp - track.seen_s)
        elif gap > 0.02:
            touching.discard(name)


def main() -> None:
    first, last = int(sys.argv[1]), int(sys.argv[2])
    settings = eval(sys.argv[3]) if len(sys.argv) > 3 else Settings()
    runs = [walk(seed, settings) for seed in range(first, last)]
    free = np.mean([not r.contacts for r in runs])
    arrived = np.mean([r.arrived for r in runs])
    times = [r.time_s for r in runs if r.arrived]
    for seed, r in zip(range(first, last), runs, strict=True):
        if r.contacts or not r.arrived:
            print(
                seed,
                [
                    (round(t, 1), n, round(u, 1))
                    for (t, n), u in zip(r.contacts, r.unseen_s, strict=True)
                ],
                r.arrived,
            )
    print(
        f"{len(runs)} runs: contact-free {100 * free:.1f} %, arrived {100 * arrived:.1f} %, "
        f"time mean {np.mean(times):.0f} max {np.max(times):.0f} s, clearance to movers "
        f"p5 {1e3 * np.percentile([r.clearance_m for r in runs], 5):.0f} mm, to what stands min "
        f"{1e3 * min(r.wall_m for r in runs):.0f} mm, guarded {np.mean([r.guarded for r in runs]):.0f} steps"
    )


if __name__ == "__main__":
    main()
