"""Sessions of different places, which must not be linked: real recordings and simulated homes, every two of them.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, islice

import numpy as np

from perception.odometry.place_recognition import describe
from perception.odometry.pyramid import build
from perception.odometry.rgbd_odometry import Odometer
from perception.odometry.session_graph import BELIEVED
from perception.odometry.session_links import PairLinks, Session, View, link_sessions
from perception.primitives.frame import Frame
from sim.scenes.home import home

from ...recordings.open import open_recording
from ..support import real_data
from ..support.experiment import Say
from ..support.handheld import drifted, frames, path
from .odometry import depth_and_colour, without_poses
from .replica_room import ReplicaRoom

RECORDINGS = {
    "living room": "redwood_livingroom",
    "cabinet": "tum_fr3_cabinet",
    "kitchen": "sevenscenes_redkitchen/sweep",
}
OFFICE = "office"
OFFICE_EVERY = 25  # of Replica's 2000 frames
PLACES = 25  # of which every two are a pair: 300
FIRST_HOME = 0  # seeds
IMAGES = 40  # of a home
MOST = 40  # images of a session that are described, as in `surefoot merge`


def session_of(seen: Iterable[Frame], seed: int) -> Session:
    """A session from frames, with poses by odometry and loop closures."""
    odometer = Odometer(np.random.default_rng(seed))
    images = []
    for frame, _ in without_poses(seen):
        odometer.track(frame)
        images.append(build(*depth_and_colour(frame)))
    poses, _ = odometer.trajectory()
    chosen = range(0, len(images), -(-len(images) // MOST))
    return Session([View(describe(k, images[k]), poses[k]) for k in chosen])


def places(count: int, first_home: int, say: Say) -> dict[str, Session]:
    """Sessions of so many places by name, recordings first, then homes by seed."""
    found: dict[str, Session] = {}
    for name, recording in islice(RECORDINGS.items(), count):
        say(f"places: {name}")
        found[name] = session_of(open_recording(real_data.folder(recording)).frames(), 0)
    if len(found) < count:
        room = ReplicaRoom(real_data.folder("replica_office0"))
        found[OFFICE] = session_of(room.frames(np.random.default_rng(0), OFFICE_EVERY), 0)
    for seed in range(first_home, first_home + count - len(found)):
        say(f"places: home {seed}")
        found[f"home {seed}"] = home_session(seed)
    return found


def home_session(seed: int) -> Session:
    """A session in a home, with poses as a tracking camera reports them."""
    scene = home(seed)
    poses = path(scene, False, IMAGES)
    seen = frames(scene, poses, np.random.default_rng([seed, 3]))
    told = drifted(poses, np.random.default_rng([seed, 4]))
    images = [build(*depth_and_colour(frame)) for frame in seen]
    views = zip(images, told, strict=True)
    return Session([View(describe(k, image), pose) for k, (image, pose) in enumerate(views)])


def every_two(found: dict[str, Session], say: Say) -> dict[tuple[str, str], PairLinks]:
    """What links every two places."""
    names: Sequence[str] = sorted(found)
    pairs = {}
    for k, (one, other) in enumerate(combinations(names, 2)):
        say(f"places: pair {k + 1} of {len(names) * (len(names) - 1) // 2}")
        pairs[one, other] = link_sessions(found[one], found[other], np.random.default_rng(k))
    return pairs


def unrelated(count: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Figures of pairs of different places."""
    pairs = every_two(places(count, FIRST_HOME, say), say)
    chances = np.array([one.probability for one in pairs.values()])
    linked = {pair: one for pair, one in pairs.items() if one.links}
    figures = {
        "unrelated_pairs": float(len(pairs)),
        "false_merges": float(np.sum(chances >= BELIEVED)),
        "unrelated_probability_max": float(np.nanmax(chances)),
        "unrelated_linked_pairs": float(len(linked)),
    }
    nearest = sorted(linked.items(), key=lambda item: -item[1].probability)[:5]
    lines = [
        f"unrelated: {' and '.join(pair)}: probability {one.probability:.4f}, {one.views} views, "
        f"fitting {one.fitting:.3f}, contradicting {one.contradicting:.3f}"
        for pair, one in nearest
    ]
    return figures, lines
