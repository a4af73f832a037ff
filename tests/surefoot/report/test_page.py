"""The page: complete, alone, and true to the files it is made from."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
import pytest

from mapping.io import nav2
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from surefoot.evaluation.evaluate import evaluate
from surefoot.report.page import write_report
from surefoot.report.plots.time_series import pictures
from surefoot.results.run_folder import RunFolder

ALL_PICTURES = [
    "map", "pose", "nees", "calibration", "whiteness", "clearance", "floor", "grid", "tracks", "commands", "timing",
]  # fmt: skip
SIGMA = np.array([0.012, 0.012, math.radians(0.7)])


def fabricate(root: Path) -> RunFolder:
    """A run as the pipeline leaves it: a walk through a room of 5 x 4 m, with honest random errors."""
    rng = np.random.default_rng(5)
    run = RunFolder.create(root)
    stamps = np.arange(0.1, 75.0, 0.325)
    s = stamps / stamps[-1]
    x, y = 0.4 + 4.2 * s, 0.6 + 2.6 * s + 0.45 * np.sin(2 * np.pi * s)
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    error = np.zeros((len(stamps), 3))
    for i in range(1, len(stamps)):  # an error that remembers itself, of deviation SIGMA
        error[i] = 0.9 * error[i - 1] + math.sqrt(1 - 0.81) * SIGMA * rng.normal(size=3)
    truth = [
        (float(t), float(a), float(b), 0.0, float(c))
        for t, a, b, c in zip(stamps, x, y, yaw, strict=True)
    ]
    run.write_trajectory("truth/trajectory.txt", truth)
    P = np.diag(SIGMA**2) + 0.5 * SIGMA[0] ** 2 * np.array([[0, 1.0, 0], [1.0, 0, 0], [0, 0, 0]])
    believed = np.column_stack([x, y, yaw]) + error
    run.write_estimates([(float(t), Gaussian(m, P)) for t, m in zip(stamps, believed, strict=True)])
    _maps(run, rng, np.column_stack([x, y]))
    _obstacles(run, rng, stamps, np.column_stack([x, y]))
    _floors(run, rng, stamps)
    _the_rest(run, rng, stamps, yaw)
    return run


def _boxes() -> list[tuple[float, float, float, float]]:
    walls = [
        (-0.1, 5.1, -0.1, 0.0),
        (-0.1, 5.1, 4.0, 4.1),
        (-0.1, 0.0, 0.0, 4.0),
        (5.0, 5.1, 0.0, 4.0),
    ]
    return [
        *walls,
        (1.3, 2.1, 0.2, 0.6),
        (2.9, 3.4, 0.5, 1.3),
        (0.2, 0.9, 2.6, 3.6),
        (3.0, 3.7, 3.1, 3.5),
    ]


def _maps(run: RunFolder, rng: np.random.Generator, way: np.ndarray) -> None:
    cell, origin = 0.05, np.array([-0.5, -0.5])
    gx, gy = np.meshgrid(np.arange(120) + 0.5, np.arange(100) + 0.5)
    px, py = gx * cell + origin[0], gy * cell + origin[1]
    occupied = np.zeros(px.shape, dtype=bool)
    for left, right, bottom, top in _boxes():
        occupied |= (px > left) & (px < right) & (py > bottom) & (py < top)
    near = np.min(np.hypot(px[..., None] - way[::9, 0], py[..., None] - way[::9, 1]), axis=-1)
    rim = cv2.dilate((~occupied).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    seen = (near < 1.35) & rim & (px > -0.1) & (px < 5.1) & (py > -0.1) & (py < 4.1)
    flip = (rng.random(px.shape) < 0.012) | ((rng.random(px.shape) < 0.1) & rim & occupied)
    everywhere = np.ones_like(occupied)
    for below, state, known in (("truth", occupied, everywhere), (".", occupied ^ flip, seen)):
        nav2.save(run.path(below), "map", state.astype(np.float32), known, origin, cell)


def _obstacles(
    run: RunFolder, rng: np.random.Generator, stamps: np.ndarray, way: np.ndarray
) -> None:
    truth, tracks, clearances = [], [], []
    P = np.diag([0.03, 0.03, 0.02, 0.02]) ** 2
    for i, t in enumerate(stamps):
        gaps = []
        for number, (cx, cy, direction) in enumerate(((2.5, 1.9, 1.0), (4.1, 1.6, -1.0))):
            phase = 0.06 * t / 0.5
            state = np.array(
                [
                    cx,
                    cy + direction * 0.5 * math.sin(phase),
                    0.0,
                    direction * 0.06 * math.cos(phase),
                ]
            )
            truth.append((t, f"mover {number + 1}", *state.tolist(), 0.1, 0.4))
            gaps.append((float(np.hypot(*(way[i] - state[:2])) - 0.20), f"mover {number + 1}"))
            if (i // 40 + number) % 3 == 2:
                continue
            mean = state + np.sqrt(np.diag(P)) * rng.normal(size=4)
            tracks.append(
                {
                    "stamp": t, "track": number + 1, "mean": mean.tolist(), "covariance": P.tolist(),
                    "radius_m": 0.11, "height_m": 0.4, "moving": 0.95, "seen": t,
                }
            )  # fmt: skip
        gaps += [
            (
                float(
                    np.hypot(
                        max(b[0] - way[i, 0], way[i, 0] - b[1], 0),
                        max(b[2] - way[i, 1], way[i, 1] - b[3], 0),
                    )
                )
                - 0.1,
                "furniture",
            )
            for b in _boxes()
        ]
        clearances.append((t, *min(gaps)))
    header = ("stamp_s", "identity", "x_m", "y_m", "vx_mps", "vy_mps", "radius_m", "height_m")
    run.write_csv("truth/obstacles.csv", header, truth)
    run.write_csv("truth/clearance.csv", ("stamp_s", "clearance_m", "thing"), clearances)
    standing = [
        {"centre_m": [(b[0] + b[1]) / 2, (b[2] + b[3]) / 2], "length_m": b[1] - b[0], "width_m": b[3] - b[2],
         "yaw_rad": 0.02, "height_m": 0.5, "covariance": np.eye(4).tolist(), "points": 900}
        for b in _boxes()[4:]
    ]  # fmt: skip
    run.write_json("obstacles.json", {"tracks": tracks, "footprints": standing})


def _floors(run: RunFolder, rng: np.random.Generator, stamps: np.ndarray) -> None:
    true, found = [], []
    deviations = {"tof": (math.radians(0.2), 0.002), "stereo": (math.radians(0.5), 0.006)}
    for t in stamps:
        for camera, (tilt, height) in deviations.items():
            normal = np.array([0.02 * math.sin(t), -0.8, -0.6])
            plane = Plane(normal / np.linalg.norm(normal), 0.383)
            true.append((t, camera, *plane.normal.tolist(), plane.offset_m))
            a, b, c = rng.normal(size=3) * (tilt, tilt, height)
            n = plane.normal + a * plane.tangents[0] + b * plane.tangents[1]
            n /= np.linalg.norm(n)
            upper = (tilt**2, 0.0, 0.0, tilt**2, 0.0, height**2)
            state = "expected" if rng.random() < 0.04 else "seen"
            found.append(
                (
                    t,
                    camera,
                    *n.tolist(),
                    plane.offset_m + c,
                    *upper,
                    0.4 + 0.2 * rng.random(),
                    state,
                )
            )
    header = ("stamp_s", "camera", "nx", "ny", "nz", "height_m")
    run.write_csv("truth/floor.csv", header, true)
    upper_names = ("P00", "P01", "P02", "P11", "P12", "P22")
    run.write_csv("floor.csv", (*header, *upper_names, "share", "state"), found)


def _the_rest(
    run: RunFolder, rng: np.random.Generator, stamps: np.ndarray, yaw: np.ndarray
) -> None:
    stages = {
        "floor": 9.0,
        "tof": 14.0,
        "stereo": 31.0,
        "localise": 2.0,
        "tracks": 3.0,
        "grid": 6.0,
        "search": 8.0,
        "field": 1.0,
        "cloud": 5.0,
    }
    rows = [(t, *(v * rng.gamma(40.0) / 40.0 for v in stages.values())) for t in stamps]
    run.write_csv("timing.csv", ("stamp_s", *stages), rows)
    run.write_csv(
        "innovations.csv",
        ("stamp_s", "source", "identity", "whitened_0", "whitened_1"),
        [(t, "landmark", i % 3, *rng.normal(size=2).tolist()) for i, t in enumerate(stamps)],
    )
    turns = np.diff(yaw[::2], append=yaw[-1])
    run.write_csv(
        "commands.csv",
        ("stamp_s", "forward_m", "lateral_m", "turn_rad", "pan_rad", "tilt_rad", "why"),
        [
            (t, 0.04 + 0.004 * rng.normal(), 0.0, turn, 0.9 * math.sin(0.7 * t), 0.6, "field")
            for t, turn in zip(stamps[::2], turns, strict=True)
        ],
    )
    views = []
    for i, t in enumerate(stamps[::24]):
        for name in ("colour", "tof"):
            ramp = np.linspace(30, 220, 288)[:, None] * np.ones((1, 360)) + 20 * rng.normal(
                size=(288, 360)
            )
            picture = cv2.applyColorMap(
                np.clip(ramp, 0, 255).astype(np.uint8),
                cv2.COLORMAP_VIRIDIS if name == "tof" else cv2.COLORMAP_BONE,
            )
            cv2.circle(picture, (40 + 25 * i, 150), 40, (40, 90, 200), -1)
            file = f"views/{len(views):03d}.jpg"
            run.write_bytes(file, cv2.imencode(".jpg", picture)[1].tobytes())
            views.append(
                {"stamp": t, "name": name, "file": file, "caption": f"{name}, t = {t:.1f} s"}
            )
    run.write_json("views.json", views)
    run.write_text("config.toml", 'scene = "home"\n')
    marks = [
        [i, x, y, 0.5, 0.12]
        for i, (x, y) in enumerate(((0.0, 1.0), (2.5, 4.0), (5.0, 2.0), (1.7, 0.6)))
    ]
    run.write_json(
        "summary.json",
        {"frames": len(stamps), "seconds": float(stamps[-1] - stamps[0]), "skipped": {}, "name": "home-5",
         "kind": "simulation", "goal_positions": [[4.65, 3.2]], "landmarks": marks, "renderer": "egl", "notes": []},
    )  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = fabricate(tmp_path_factory.mktemp("report") / "home-5")
    evaluate(folder)
    write_report(folder)
    return folder


CHROMIUM = next(
    (
        found
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (found := shutil.which(name))
    ),
    None,
)
QUIET = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-default-apps", "--disable-extensions", "--host-resolver-rules=MAP * ~NOTFOUND",
]  # fmt: skip
THE_BROWSER_ITSELF = "not an origin"  # as the net log names who asked for updates and the like


class Page(HTMLParser):
    """What the page refers to, and which elements it has."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.identities: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        said = dict(attrs)
        self.references += [
            str(said[name]) for name in ("src", "href", "srcset", "action") if name in said
        ]
        if said.get("id"):
            self.identities.append(str(said["id"]))
        if tag == "img":
            self.images.append(said)


def browse(page: Path, scratch: Path) -> tuple[str, list[str]]:
    """The page as Chromium has it after everything was loaded, and the addresses that it asked for."""
    if CHROMIUM is None:
        pytest.skip("no chromium on the PATH: THE PAGE WAS NOT RENDERED; apt-get install chromium")
    profile, log = scratch / "profile", scratch / "net.json"
    arguments = [
        CHROMIUM,
        *QUIET,
        f"--user-data-dir={profile}",
        f"--log-net-log={log}",
        "--dump-dom",
    ]
    done = subprocess.run(
        [*arguments, page.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    text = log.read_text()
    try:
        said = json.loads(text)
    except json.JSONDecodeError:  # a log that was not closed lacks its last brackets
        said = json.loads(text.rstrip().rstrip(",") + "]}")
    start = said["constants"]["logEventTypes"]["URL_REQUEST_START_JOB"]
    asked = [
        event["params"] for event in said["events"] if event["type"] == start and "params" in event
    ]
    urls = [
        str(one["url"])
        for one in asked
        if "url" in one and one.get("initiator") != THE_BROWSER_ITSELF
    ]
    return done.stdout, [url for url in urls if not url.startswith(("file:", "data:"))]


def test_the_page_holds_every_picture_and_refers_to_nothing_outside(run):
    text = run.path("report.html").read_text()
    page = Page(text)
    assert [name for name in page.identities if name in ALL_PICTURES] == ALL_PICTURES
    assert "views" in page.identities
    assert page.references
    assert all(re.match(r"data:|#", reference) for reference in page.references)
    assert not re.search(
        r"@import|url\(|https?://|fetch\(|XMLHttpRequest|<link rel=.stylesheet", text
    )
    assert all(image.get("alt") for image in page.images)
    for name in ALL_PICTURES:
        assert (run.root / "figures" / f"{name}.svg").stat().st_size > 2000


def test_a_browser_shows_every_image_and_asks_nobody(run, tmp_path):
    document, asked = browse(run.path("report.html"), tmp_path)
    said = re.search(r'<html[^>]*data-images="(\d+)"[^>]*data-images-shown="(\d+)"', document)
    assert said is not None, "the page's script did not run"
    pictures_and_views = len(ALL_PICTURES) + len(run.read_json("views.json"))
    assert said.groups() == (str(pictures_and_views), str(pictures_and_views))
    assert len(re.findall(r'class="shot shown"', document)) == 1  # the slider's script works
    assert all(f'id="{name}"' in document for name in (*ALL_PICTURES, "views"))
    assert asked == []


def test_the_watch_over_requests_sees_one(tmp_path):
    (tmp_path / "page.html").write_text('<img src="http://outside.invalid/x.png">')
    assert browse(tmp_path / "page.html", tmp_path)[1] == ["http://outside.invalid/x.png"]


def test_drawing_leaves_matplotlib_as_it_was(run):
    before = dict(mpl.rcParams)
    assert [picture.identity for picture in pictures(run)] == ALL_PICTURES
    assert dict(mpl.rcParams) == before


def test_the_same_run_gives_the_same_page(run):
    first = run.path("report.html").read_bytes()
    write_report(run)
    assert run.path("report.html").read_bytes() == first


def test_numbers_at_the_top_are_those_of_the_metrics(run):
    text = run.path("report.html").read_text()
    metrics = run.read_json("metrics.json")
    assert f"{100 * metrics['position_rmse_m']:.1f} cm" in text
    assert f"{metrics['grid_correct_share']:.1%}" in text
    assert "8 of 8 targets met" in text


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without pictures, for tests of their words."""
    monkeypatch.setattr("surefoot.report.page.pictures", lambda run: [])


def test_a_missed_target_is_said(run, tmp_path, undrawn):
    bad = RunFolder(shutil.copytree(run.root, tmp_path / "bad"))
    table = bad.read_trajectory("truth/trajectory.txt")
    assert table is not None
    shifted = [
        (float(t), float(x) + 0.2, float(y), 0.0, float(yaw))
        for t, (x, y, _), yaw in zip(table.stamps, table.positions, table.yaws, strict=True)
    ]
    bad.write_trajectory("truth/trajectory.txt", shifted)
    evaluate(bad)
    text = write_report(bad).read_text()
    assert "6 of 8 targets met" in text  # position, and with it the covariance
    assert text.count("✗ missed") == 2


def test_a_recording_without_truth_has_a_page_too(run, tmp_path):
    bare = RunFolder(shutil.copytree(run.root, tmp_path / "bare"))
    shutil.rmtree(bare.root / "truth")
    for name in ("metrics.json", "commands.csv", "views.json"):
        bare.path(name).unlink()
    page = Page(write_report(bare).read_text())
    shown = [name for name in page.identities if name in ALL_PICTURES]
    assert shown == ["map", "calibration", "whiteness", "floor", "timing"]
    assert "no truth to judge it by" in bare.path("report.html").read_text()
    assert "position_rmse_m" not in bare.read_json("metrics.json")


def test_a_camera_in_the_hand_without_poses_has_a_page_too(run, tmp_path):
    bare = RunFolder.create(tmp_path / "hand")
    for name in ("floor.csv", "timing.csv", "summary.json"):
        bare.write_bytes(name, run.path(name).read_bytes())
    bare.write_estimates([])
    bare.write_json("obstacles.json", {"tracks": [], "footprints": []})
    shown = Page(write_report(bare).read_text()).identities
    assert [name for name in shown if name in ALL_PICTURES] == ["floor", "timing"]


def test_words_from_files_cannot_become_markup(run, tmp_path, undrawn):
    sly = RunFolder(shutil.copytree(run.root, tmp_path / "sly"))
    summary = sly.read_json("summary.json")
    summary |= {
        "name": "<script>alert(1)</script>",
        "notes": ["<img src=http://x>"],
        "skipped": {"<b>": 2},
    }
    sly.write_json("summary.json", summary)
    text = write_report(sly).read_text()
    assert "<script>alert" not in text
    assert "<img src=http" not in text
    assert "skipped 2: &lt;b&gt;" in text
