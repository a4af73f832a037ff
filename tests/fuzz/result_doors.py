"""Doors of results: run folders, checkpoints, batches, estimates of others, and requests to the live page."""

from __future__ import annotations

import atexit
import contextlib
import gc
import hashlib
import http.client
import json
import shutil
import socket
import tempfile
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np
from door import Door
from recording_doors import POSES

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.io import geotiff, grid_file, nav2
from mapping.surface.traversability import load_layers
from perception.odometry.session_graph import join
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import DepthView, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from surefoot.batch import batch, pages
from surefoot.batch.job import DONE, PROCESS, Job
from surefoot.batch.ledger import LEDGER, Ledger
from surefoot.batch.places import Order
from surefoot.batch.work import figures_of
from surefoot.config import toml
from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.evaluation.foreign_graph import read_g2o
from surefoot.evaluation.foreign_trajectory import read_trajectory
from surefoot.evaluation.referee import judge_files
from surefoot.experiments.support import artefacts
from surefoot.library.run_results import opened
from surefoot.offline.mapped_session import MappedSession, read_images
from surefoot.offline.smooth import smooth_run
from surefoot.recordings.codec import encode
from surefoot.recordings.identity import identity
from surefoot.recordings.mcap_format import RecordingWriter
from surefoot.recordings.open import open_recording
from surefoot.recordings.recording import RecordingInfo
from surefoot.report import page
from surefoot.report.film import film
from surefoot.report.live_view import LivePage
from surefoot.report.replay.page import write_replay
from surefoot.results import object_file
from surefoot.results.moment import Moment
from surefoot.results.moments import MomentWriter, read_moments
from surefoot.results.run_folder import COVARIANCE_HEADER, SPACE_HEADER, RunFolder
from surefoot.results.tracking import TRACKING_HEADER
from surefoot.run import checkpoint, process

WALK = Path(__file__).parents[2] / "data" / "walk"
FRAMES = 4  # of the run


def quiet(text: str) -> None:
    """Says nothing."""


def short_walk(folder: Path) -> Path:
    """The first frames of the walk, with its truth."""
    folder.mkdir(parents=True)
    walk = open_recording(WALK)
    with RecordingWriter(folder / "recording.mcap", walk.info) as writer:
        for number, frame in enumerate(walk.frames()):
            if number == FRAMES:
                break
            writer.write(encode(frame))
    shutil.copytree(WALK / "truth", folder / "truth")
    return folder


@cache
def walked() -> Path:
    """A place with the short walk in walk/ and its run, without report, in run/."""
    place = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    with patch.object(page, "write_report", lambda run: None):
        process.process(short_walk(place / "walk"), None, Config(), place / "run", quiet)
    return place


def whole_run(folder: Path) -> None:
    """Everything that a run of any kind has."""
    shutil.copytree(walked() / "run", folder, dirs_exist_ok=True)
    run = RunFolder(folder)
    side = {"length_m": 0.4, "seen": 1.0}
    corners = [[0.0, 0.0], [0.4, 0.0], [0.4, 0.4], [0.0, 0.4]]
    run.write_json("truth/outlines.json", [{"parts_m": [corners], "sides": 4 * [side]}])
    box = {"seen": True, "sigma_m": 0.01}
    footprint = {
        "outline_m": corners, "sides": 4 * [box], "height_m": 0.3, "sigma_height_m": 0.01, "probability": 0.9,
        "several": False, "points": 40,
        "box": {"centre_m": [0.2, 0.2], "length_m": 0.4, "width_m": 0.4, "yaw_rad": 0.0, "sigma_length_m": 0.01,
                "sigma_width_m": None, "covariance": [[1e-4, 0.0], [0.0, 1e-4]]},
    }  # fmt: skip
    tracks = (run.read_json("obstacles.json") or {})["tracks"]
    run.write_json("obstacles.json", {"tracks": tracks, "footprints": [footprint]})
    gap = {
        "left_rad": 0.9,
        "right_rad": 0.4,
        "distance_m": 1.0,
        "width_m": 0.4,
        "sigma_width_m": 0.1,
    }
    edges = {"left_edge_m": [1.0, 0.4], "right_edge_m": [1.0, -0.1]}
    views = [{"placed": False, "frame": 1, "reason": "x"}, {"placed": True, "frame": 2}]
    run.write_json("panorama.json", {"views": views, "obstacles": [gap | edges], "gaps": [gap]})
    run.write_json("monocular.json", {"frames": 2, "judged": 1, "iou": 0.9, "iou_min": 0.8})
    merged_files(run, corners)
    cells = np.ones((6, 8))
    layers = {"elevation": cells, "slope": cells, "traversability": cells / 2}
    np.savez_compressed(
        run.path("layers.npz"), origin=np.zeros(2), resolution=np.array(0.1), **layers
    )
    evaluate(run)


def merged_files(run: RunFolder, corners: list[list[float]]) -> None:
    """What a merged map has beside the files of a map."""
    session = {
        "session": 1, "name": "x", "map": "a", "recording": "b", "digest": "c", "frames": 4, "part": 1, "shift_s": 0.0,
        "from_s": 0.0, "to_s": 9.0,
    }  # fmt: skip
    pair = {
        "sessions": [1, 2], "probability": 0.9, "merged": True, "links": 3, "views": 2, "compared": 5, "fitting": 0.9,
        "contradicting": None,
    }  # fmt: skip
    content = {"part": 1, "sessions": [session, session | {"session": 2}], "pairs": [pair], "parts": [[1, 2]]}  # fmt: skip
    run.write_json("sessions.json", content)
    place = {
        "outline_m": corners, "position_m": [0.2, 0.2], "covariance": [[1e-3, 0.0], [0.0, 1e-3]], "size_m": [0.4, 0.4, 0.5],
        "probability": 0.9, "voxels": 40,
    }  # fmt: skip
    change = {"sessions": [1, 2], "kind": "moved", "probability": 0.8, "before": place, "after": place}  # fmt: skip
    run.write_json("changes.json", {"changes": [change]})


def mapped_session(folder: Path) -> None:
    """A small map of a camera, with its recording."""
    run, camera = RunFolder.create(folder), Camera(48, 40, 40.0, 40.0, 23.5, 19.5)
    rng, stamps = np.random.default_rng(2), (0.0, 0.5, 1.0)
    with RecordingWriter(folder / "recording.mcap", RecordingInfo("x", "mcap")) as writer:
        for stamp in stamps:
            depth = DepthView(rng.uniform(1.0, 2.0, (40, 48)).astype(np.float32), camera)
            writer.write(encode(Frame(stamp, depth=depth)))
    run.write_text("trajectory.txt", "".join(f"{t} {t} 0 1 0 0 0 1\n" for t in stamps))
    run.write_csv(
        "space_covariance.csv", SPACE_HEADER, [(t, *(42 * [1e-4 * (1 + t)])) for t in stamps]
    )
    run.write_csv("tracking.csv", TRACKING_HEADER, [(t, "tracked", 0.1, False) for t in stamps])
    information = " ".join("9" if i == j else "0" for i in range(6) for j in range(i, 6))
    vertices = "".join(f"VERTEX_SE3:QUAT {k} {k / 2} 0 0 0 0 0 1\n" for k in range(3))
    edges = "".join(f"EDGE_SE3:QUAT {k} {k + 1} 0.5 0 0 0 0 0 1 {information}\n" for k in range(2))
    run.write_text("graph.g2o", vertices + edges)
    run.write_text("config.toml", toml.dumps(Config()))
    summary = {"kind": "map", "name": "x", "frames": 3, "command": "surefoot map x"}
    run.write_json("summary.json", summary)


def read_session(folder: Path) -> None:
    """As `merge` does with each map."""
    session = MappedSession.open(folder)
    join([read_images(session, quiet).graph], {}, [0])


def read_run(folder: Path) -> None:
    """As `evaluate`, `smooth` and the library do."""
    run = RunFolder.open(folder)
    run.write_json("metrics.json", evaluate(run))
    smooth_run(run)
    loaded = opened(folder, None)
    for name in ("sessions.json", "changes.json"):
        run.read_json(name)
    for name in ("trajectory", "poses_in_space", "tracks", "footprints", "floor", "grid", "map", "layers", "summary", "metrics"):  # fmt: skip
        getattr(loaded, name)


def show_run(folder: Path) -> None:
    """As `replay` and `film` do."""
    run = RunFolder.open(folder)
    write_replay(run)
    film(run, folder / "film.webp")


def simple_run(folder: Path) -> None:
    """A small run with its truth."""
    run = RunFolder.create(folder)
    run.write_text("trajectory.txt", POSES)
    rows = [(10 + k / 2, 0.1 * k, 0.0, 0.0, 1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4) for k in range(6)]
    run.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, rows)
    run.write_json("summary.json", {"kind": "simulation", "name": "x", "frames": 6, "seconds": 2.5})
    run.write_text("truth/trajectory.txt", POSES)


def killed_run(folder: Path) -> None:
    """A run that was killed after two frames, with its checkpoint."""
    said: list[str] = []

    def say(text: str) -> None:
        said.append(text)
        if len(said) == 2:
            raise KeyboardInterrupt

    with patch.object(checkpoint, "EVERY_S", 0.0), contextlib.suppress(KeyboardInterrupt):
        process.process(walked() / "walk", None, Config(), folder, say)
    gc.collect()  # the run lets go of its folder


def resume(folder: Path) -> None:
    """As `process --resume` does, up to the first frame."""
    recorded = identity(walked() / "walk", None, folder)
    assert checkpoint.load(RunFolder.held(folder), Config(), recorded) is not None


def batch_folder(folder: Path) -> None:
    """Two finished runs of a batch, its table, and an experiment."""
    for name in ("a", "b"):
        simple_run(folder / name)
        summary = {"name": name, "frames": 6, "skipped": {"dark": 1}, "seconds": 2.5}
        RunFolder(folder / name).write_json("summary.json", summary)
        (folder / name / "report.html").write_text("x")
    order, jobs = batch_of(folder)
    ledger = Ledger.open(folder / LEDGER, batch.header_of(order))
    more = {"identity": jobs[0].identity, "wall_s": 3.0, "figures": {"frames": 6.0}}
    ledger.note("a", DONE, source=jobs[0].source, reason="", **more)
    result = {"title": "x", "figures": {"a": 1.0}, "seeds": 2, "targets": {"a": ["<", 2.0]}}
    (folder / "result.json").write_text(json.dumps(result))


def batch_of(folder: Path) -> tuple[Order, list[Job]]:
    """The jobs of the two runs."""
    jobs = [Job(name, PROCESS, f"{name}.mcap", str(folder / name), identity="x") for name in "ab"]
    return Order(PROCESS), jobs


def read_batch(folder: Path) -> None:
    """As a batch that goes on, and a round of experiments do."""
    order, jobs = batch_of(folder)
    ledger = Ledger.open(folder / LEDGER, batch.header_of(order))
    if (
        not all(figures_of(job)["frames"] for job in jobs)
        or pages.rows(jobs, ledger)[0].status != DONE
    ):
        raise InputError("not read")
    result = artefacts.read(folder)
    if result is None:
        raise InputError("not read")
    artefacts.verdicts(result)


def maps(folder: Path) -> None:
    """Maps of a run."""
    rng = np.random.default_rng(3)
    probability = rng.uniform(0, 1, (9, 7)).astype(np.float32)
    known = rng.random((9, 7)) < 0.8
    nav2.save(folder, "map", probability, known, np.zeros(2), 0.05)
    nav2.save_scale(folder, "scale", probability, known, np.zeros(2), 0.05)
    geotiff.save(folder / "layers.tif", {"height": probability}, np.zeros(2), 0.05)
    grid_file.save(folder / "terrain.npz", EgocentricGrid(GridConfig(), np.zeros(2)))
    layers = {"elevation": probability, "slope": probability, "traversability": probability}
    np.savez(folder / "layers.npz", origin=np.zeros(2), resolution=np.array(0.1), **layers)


def read_maps(folder: Path) -> None:
    """All of them."""
    for name in ("map.yaml", "scale.yaml"):
        nav2.load(folder / name)
    geotiff.load(folder / "layers.tif")
    grid_file.load(folder / "terrain.npz")
    load_layers(folder / "layers.npz")


def trajectories(folder: Path) -> None:
    """Estimates of others."""
    (folder / "tum.txt").write_text(POSES)
    (folder / "kitti.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0.1 0 1 0 0 0 0 1 0\n")
    euroc = "".join(f"{k}00000000,0.1,0.2,0.3,1,0,0,0\n" for k in range(1, 4))
    (folder / "euroc.csv").write_text("#timestamp, x, y, z, qw, qx, qy, qz\n" + euroc)
    (folder / "places.csv").write_text("z,y,x,stamp\n" + "0.1,0.2,0.3,4\n0.1,0.2,0.3,5\n")
    information = " ".join("1" if i == j else "0" for i in range(6) for j in range(i, 6))
    vertices = "".join(f"VERTEX_SE3:QUAT {k} {k} 0 0 0 0 0 1\n" for k in range(3))
    edges = "".join(f"EDGE_SE3:QUAT {k} {k + 1} 1 0 0 0 0 0 1 {information}\n" for k in range(2))
    (folder / "graph.g2o").write_text(vertices + edges)


def read_trajectories(folder: Path) -> None:
    """All of them."""
    for name in ("tum.txt", "kitti.txt", "euroc.csv", "places.csv", "graph.g2o"):
        read_trajectory(folder / name)
    read_g2o(folder / "graph.g2o")


def claims(folder: Path) -> None:
    """A trajectory of somebody's SLAM, its truth and its covariances in three forms."""
    poses = [(10 + k / 10, 0.1 * k, 0.01 * k * k, 0.1) for k in range(12)]
    text = "".join(f"{t:.3f} {x} {y} {z} 0 0 0 1\n" for t, x, y, z in poses)
    (folder / "found.txt").write_text(text)
    shifted = "".join(f"{t:.3f} {x + 0.003 * (k % 3)} {y} {z} 0 0 0 1\n" for k, (t, x, y, z) in enumerate(poses))  # fmt: skip
    (folder / "true.txt").write_text(shifted)
    P = 1e-4 * np.eye(6)
    np.savetxt(folder / "space.csv", [[t, *P.ravel()] for t, *_ in poses], delimiter=",")
    rows = "".join(f"{t},1e-4,0,0,1e-4,0,1e-4\n" for t, *_ in poses)
    (folder / "planar.csv").write_text("stamp_s,P_xx,P_xy,P_xyaw,P_yy,P_yyaw,P_yawyaw\n" + rows)
    information = " ".join("9" if i == j else "0" for i in range(6) for j in range(i, 6))
    vertices = "".join(
        f"VERTEX_SE3:QUAT {k} {x} {y} {z} 0 0 0 1\n" for k, (_, x, y, z) in enumerate(poses)
    )
    edges = "".join(f"EDGE_SE3:QUAT {k} {k + 1} 0.1 0 0 0 0 0 1 {information}\n" for k in range(11))
    (folder / "graph.g2o").write_text(vertices + edges)


def judge_claims(folder: Path) -> None:
    """As `evaluate --trajectory` does."""
    for name, body_axes in (("space.csv", True), ("planar.csv", False), ("graph.g2o", False)):
        judge_files(folder / "found.txt", folder / name, folder / "true.txt", body_axes=body_axes)


def objects(folder: Path) -> None:
    """What a checkpoint is made of."""
    value = [
        Config(),
        np.arange(9.0),
        Pose2(1.0, 2.0, 3.0),
        np.random.default_rng(1),
        {"a": (1, 2)},
    ]
    (folder / "state").write_bytes(object_file.dumps(value))


def forged(folder: Path) -> None:
    """The JSON of such a file; its checksum is made right again."""
    objects(folder)
    content = (folder / "state").read_bytes()[len(object_file.MAGIC) + 32 :]
    length = int.from_bytes(content[:8], "little")
    (folder / "state").unlink()
    (folder / "header").write_bytes(content[8 : 8 + length])
    (folder / "arrays").write_bytes(content[8 + length :])


def read_forged(folder: Path) -> None:
    """As a forger would hand it in."""
    header, arrays = (folder / "header").read_bytes(), (folder / "arrays").read_bytes()
    body = len(header).to_bytes(8, "little") + header + arrays
    object_file.loads(object_file.MAGIC + hashlib.sha256(body).digest() + body)


def estimates(folder: Path) -> None:
    """What a run knew at two moments."""
    run, state = RunFolder.create(folder), Gaussian(np.zeros(4), np.eye(4))
    writer = MomentWriter(run)
    for k in range(2):
        track = Obstacle(state, 0.1, 0.4, 3, 0.5, 1.0, 0.0)
        pose = Gaussian(np.array([0.1 * k, 0.0, 0.0]), 1e-4 * np.eye(3))
        depth = np.full((12, 16), 30 + k, np.uint8)
        writer.write(
            Moment(1.0 + k, pose, tracks=(track,), why="walk", depth=depth, depth_step_m=0.01)
        )
    writer.close(())


@cache
def live_page() -> LivePage:
    """A page that shows nothing yet."""
    return LivePage()


def requests(folder: Path) -> None:
    """What browsers send."""
    port = live_page().address.rpartition(":")[2].strip("/")
    head = f"Host: localhost:{port}\r\nConnection: close\r\n"
    command = b'{"paused": true, "speed": 2.0, "step": false}'
    (folder / "page").write_bytes(f"GET / HTTP/1.1\r\n{head}\r\n".encode())
    (folder / "moments").write_bytes(f"GET /moments?from=99 HTTP/1.1\r\n{head}\r\n".encode())
    kind = f"Content-Type: application/json\r\nContent-Length: {len(command)}\r\n"
    (folder / "walk").write_bytes(f"POST /walk HTTP/1.1\r\n{head}{kind}\r\n".encode() + command)


def send(folder: Path) -> None:
    """Send each to the page, which must answer or close, and be there afterwards."""
    port = int(live_page().address.rpartition(":")[2].strip("/"))
    answers = []
    for path in (folder / "page", folder / "walk"):
        with socket.create_connection(("127.0.0.1", port), timeout=5) as line:
            line.sendall(path.read_bytes())
            line.shutdown(socket.SHUT_WR)
            answers.append(line.recv(100))
    after = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    after.request("GET", "/", headers={"Host": "localhost"})
    assert after.getresponse().status == 200
    after.close()
    if not all(answer.startswith(b"HTTP/1.0 200") for answer in answers):
        raise InputError("refused")


DOORS = {
    "maps": Door(maps, read_maps),
    "trajectories": Door(trajectories, read_trajectories),
    "claims": Door(claims, judge_claims),
    "simple_run": Door(simple_run, lambda folder: evaluate(RunFolder.open(folder))),
    "whole_run": Door(whole_run, read_run, slow=True),
    "shown_run": Door(whole_run, show_run, slow=True),
    "session": Door(mapped_session, read_session, slow=True),
    "report": Door(whole_run, lambda folder: page.write_report(RunFolder.open(folder)), slow=True),
    "batch": Door(batch_folder, read_batch),
    "checkpoint": Door(killed_run, resume),
    "estimates": Door(estimates, lambda folder: list(read_moments(RunFolder(folder)))),
    "objects": Door(objects, lambda folder: object_file.loads((folder / "state").read_bytes())),
    "forged": Door(forged, read_forged),
    "live": Door(requests, send),
}
