"""The report page: complete, without outside references, and true to the files of the run."""

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

from mapping.io import clouds, nav2
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from surefoot.evaluation.evaluate import evaluate
from surefoot.report.page import write_report
from surefoot.report.plots import consistency, time_series
from surefoot.results.row_stream import RowStream
from surefoot.results.run_folder import COVARIANCE_HEADER, RunFolder, estimate_row

ALL_PICTURES = [
    "map", "pose", "nees", "calibration", "whiteness", "clearance", "floor", "grid", "tracks", "commands", "timing",
]  # fmt: skip
SIGMA = np.array([0.012, 0.012, math.radians(0.7)])


def fabricate(root: Path) -> RunFolder:
    """A run as the pipeline writes it: a walk through a room of 5 x 4 m, with consistent random errors."""
    rng = np.random.default_rng(5)
    run = RunFolder.create(root)
    stamps = np.arange(0.1, 75.0, 0.325)
    s = stamps / stamps[-1]
    x, y = 0.4 + 4.2 * s, 0.6 + 2.6 * s + 0.45 * np.sin(2 * np.pi * s)
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    error = np.zeros((len(stamps), 3))
    for i in range(1, len(stamps)):  # autocorrelated errors of standard deviation SIGMA
        error[i] = 0.9 * error[i - 1] + math.sqrt(1 - 0.81) * SIGMA * rng.normal(size=3)
    truth = [
        (float(t), float(a), float(b), 0.0, float(c))
        for t, a, b, c in zip(stamps, x, y, yaw, strict=True)
    ]
    run.write_trajectory("truth/trajectory.txt", truth)
    P = np.diag(SIGMA**2) + 0.5 * SIGMA[0] ** 2 * np.array([[0, 1.0, 0], [1.0, 0, 0], [0, 0, 0]])
    estimates = np.column_stack([x, y, yaw]) + error
    rows = [estimate_row(float(t), Gaussian(m, P)) for t, m in zip(stamps, estimates, strict=True)]
    run.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, rows)
    run.write_planar_trajectory()
    _maps(run, rng, np.column_stack([x, y]))
    _obstacles(run, rng, stamps, np.column_stack([x, y]))
    _floors(run, rng, stamps)
    _other_tables(run, rng, stamps, yaw)
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


def _maps(run: RunFolder, rng: np.random.Generator, path: np.ndarray) -> None:
    cell, origin = 0.05, np.array([-0.5, -0.5])
    gx, gy = np.meshgrid(np.arange(120) + 0.5, np.arange(100) + 0.5)
    px, py = gx * cell + origin[0], gy * cell + origin[1]
    occupied = np.zeros(px.shape, dtype=bool)
    for left, right, bottom, top in _boxes():
        occupied |= (px > left) & (px < right) & (py > bottom) & (py < top)
    near = np.min(np.hypot(px[..., None] - path[::9, 0], py[..., None] - path[::9, 1]), axis=-1)
    rim = cv2.dilate((~occupied).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    seen = (near < 1.35) & rim & (px > -0.1) & (px < 5.1) & (py > -0.1) & (py < 4.1)
    flip = (rng.random(px.shape) < 0.012) | ((rng.random(px.shape) < 0.1) & rim & occupied)
    everywhere = np.ones_like(occupied)
    for below, state, known in (("truth", occupied, everywhere), (".", occupied ^ flip, seen)):
        nav2.save(run.path(below), "map", state.astype(np.float32), known, origin, cell)


def _obstacles(
    run: RunFolder, rng: np.random.Generator, stamps: np.ndarray, path: np.ndarray
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
            gaps.append((float(np.hypot(*(path[i] - state[:2])) - 0.20), f"mover {number + 1}"))
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
                        max(b[0] - path[i, 0], path[i, 0] - b[1], 0),
                        max(b[2] - path[i, 1], path[i, 1] - b[3], 0),
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
    run.write_csv("truth/clearance.csv", ("stamp_s", "clearance_m", "object"), clearances)
    standing = [
        {"outline_m": [[b[0], b[2]], [b[1], b[2]], [b[1], b[3]], [b[0], b[3]]],
         "sides": [{"seen": k < 2, "sigma_m": 0.01 if k < 2 else None} for k in range(4)],
         "height_m": 0.5, "sigma_height_m": 0.01, "probability": 0.9, "several": False, "points": 900, "box": None}
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


def _other_tables(
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
BROWSER_ITSELF = "not an origin"  # initiator of updates in the net log


class Page(HTMLParser):
    """References and elements of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.identities: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.references += [
            str(given[name]) for name in ("src", "href", "srcset", "action") if name in given
        ]
        if given.get("id"):
            self.identities.append(str(given["id"]))
        if tag == "img":
            self.images.append(given)


def browse(page: Path, scratch: Path) -> tuple[str, list[str]]:
    """The page in Chromium after loading, and the addresses that it requested."""
    if CHROMIUM is None:
        pytest.skip("no chromium on the PATH: the page was not rendered; apt-get install chromium")
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
        log_data = json.loads(text)
    except json.JSONDecodeError:  # a log that was not closed lacks its last brackets
        log_data = json.loads(text.rstrip().rstrip(",") + "]}")
    start = log_data["constants"]["logEventTypes"]["URL_REQUEST_START_JOB"]
    asked = [
        event["params"]
        for event in log_data["events"]
        if event["type"] == start and "params" in event
    ]
    urls = [
        str(one["url"]) for one in asked if "url" in one and one.get("initiator") != BROWSER_ITSELF
    ]
    return done.stdout, [url for url in urls if not url.startswith(("file:", "data:"))]


def test_the_page_contains_every_plot_and_no_outside_reference(run):
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


def test_a_browser_shows_every_image_without_any_request(run, tmp_path):
    document, asked = browse(run.path("report.html"), tmp_path)
    counted = re.search(r'<html[^>]*data-images="(\d+)"[^>]*data-images-shown="(\d+)"', document)
    assert counted is not None, "the page's script did not run"
    pictures_and_views = len(ALL_PICTURES) + len(run.read_json("views.json"))
    assert counted.groups() == (str(pictures_and_views), str(pictures_and_views))
    assert len(re.findall(r'class="shot shown"', document)) == 1  # the slider's script works
    assert all(f'id="{name}"' in document for name in (*ALL_PICTURES, "views"))
    assert asked == []


def test_a_request_would_be_noticed(tmp_path):
    (tmp_path / "page.html").write_text('<img src="http://outside.invalid/x.png">')
    assert browse(tmp_path / "page.html", tmp_path)[1] == ["http://outside.invalid/x.png"]


def test_the_same_run_gives_the_same_page_and_drawing_leaves_matplotlib_as_it_was(run):
    first = run.path("report.html").read_bytes()
    with mpl.rc_context():
        mpl.rcdefaults()
        before = dict(mpl.rcParams)
        write_report(run)
        assert dict(mpl.rcParams) == before
    assert run.path("report.html").read_bytes() == first


def test_the_cards_show_the_figures_of_the_metrics(run):
    text = run.path("report.html").read_text()
    metrics = run.read_json("metrics.json")
    assert f"{100 * metrics['position_rmse_m']:.1f} cm" in text
    assert f"{metrics['grid_correct_share']:.1%}" in text
    assert "missed: position" not in text
    assert "missed: pose" not in text


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without plots, for tests of their text."""
    monkeypatch.setattr("surefoot.report.page.pictures", lambda run: [])


def test_a_missed_target_is_shown(run, tmp_path, undrawn):
    bad = RunFolder(shutil.copytree(run.root, tmp_path / "bad"))
    table = bad.read_trajectory("truth/trajectory.txt")
    assert table is not None
    shifted = [
        (float(t), float(x) + 0.2, float(y), 0.0, float(yaw))
        for t, (x, y, _), yaw in zip(table.stamps, table.positions, table.yaws, strict=True)
    ]
    before = write_report(bad).read_text().count("✗ missed")
    bad.write_trajectory("truth/trajectory.txt", shifted)
    evaluate(bad)
    text = write_report(bad).read_text()
    assert re.search(
        r"missed: position error, RMS \((0\.2|0\.19\d|0\.20\d) m, at most 0\.05 m\)", text
    )
    assert "(too sure: errors " in text
    assert text.count("✗ missed") == before + 2  # position, and consistency of its covariance


def test_the_names_of_the_calibration_stand_beside_the_curves_in_their_colours(run):
    curves, means = consistency.calibration(run).figure.axes
    assert curves.get_legend() is None
    drawn = [line.get_color() for line in curves.get_lines()[1:]]  # the first is the diagonal
    assert [name.get_color() for name in means.get_yticklabels()] == drawn


def test_a_recording_without_truth_has_a_page_too(run, tmp_path):
    bare = RunFolder(shutil.copytree(run.root, tmp_path / "bare"))
    shutil.rmtree(bare.root / "truth")
    for name in ("metrics.json", "commands.csv", "views.json"):
        bare.path(name).unlink()
    page = Page(write_report(bare).read_text())
    shown = [name for name in page.identities if name in ALL_PICTURES]
    assert shown == ["map", "calibration", "whiteness", "floor", "timing"]
    # footprints are judged without a truth: own poses inside, and share over free cells
    assert "of 2 targets met" in bare.path("report.html").read_text()
    assert "position_rmse_m" not in bare.read_json("metrics.json")


def test_a_camera_in_the_hand_without_poses_has_a_page_too(run, tmp_path):
    bare = RunFolder.create(tmp_path / "hand")
    for name in ("floor.csv", "timing.csv", "summary.json"):
        bare.write_bytes(name, run.path(name).read_bytes())
    bare.write_json("obstacles.json", {"tracks": [], "footprints": []})
    shown = Page(write_report(bare).read_text()).identities
    assert [name for name in shown if name in ALL_PICTURES] == ["floor", "timing"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("frames", [1, 3])
def test_a_short_run_is_drawn_without_warnings(run, tmp_path, frames):
    short = RunFolder(shutil.copytree(run.root, tmp_path / "short"))
    for name in ("floor.csv", "timing.csv", "commands.csv", "innovations.csv", "trajectory_covariance.csv",
                 "truth/clearance.csv", "truth/floor.csv", "truth/trajectory.txt"):  # fmt: skip
        lines = short.path(name).read_text().splitlines()
        short.write_text(name, "\n".join(lines[: 1 + frames]) + "\n")
    short.write_planar_trajectory()
    for name in ("metrics.json", "obstacles.json", "truth/obstacles.csv"):
        short.path(name).unlink()
    assert "clearance" in Page(write_report(short).read_text()).identities


def test_the_top_view_of_a_surface_has_the_axes_of_the_map():
    from surefoot.report.plots.surface import _views, splat

    above = _views()[0]
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.5]]) @ above.T
    picture, extent = splat(points, np.array([[9, 0, 0], [0, 9, 0], [0, 0, 9]], np.uint8))
    assert picture[0, -1].tolist() == [0, 9, 0]  # x to the right
    assert picture[-1, -1].tolist() == [0, 0, 9]  # y up
    assert extent[1] - extent[0] > extent[3] - extent[2]
    for view in _views():
        np.testing.assert_allclose(view @ view.T, np.eye(3), atol=1e-12)


def test_the_picture_of_a_mesh_shows_the_topmost_front_side():
    """A floor of 2 m x 1 m, a red board over its right half that faces up, and a blue one that faces down."""
    from surefoot.report.plots.surface import AMBIENT, BACKGROUND, cast

    def board(left: float, right: float, z: float) -> list[list[float]]:
        return [[left, 0.0, z], [right, 0.0, z], [right, 1.0, z], [left, 1.0, z]]

    points = np.array(board(0.0, 2.0, 0.0) + board(1.0, 2.0, 0.5) + board(0.0, 1.0, 1.0))
    up = np.array([[0, 1, 2], [0, 2, 3]])
    triangles = np.concatenate([up, up + 4, up[:, ::-1] + 8])
    tones = np.array([[0, 200, 0], [200, 0, 0], [0, 0, 200]], np.uint8).repeat(4, axis=0)
    picture, extent = cast(points, triangles, tones)
    height, width, _ = picture.shape
    assert picture[height // 2, width // 4].tolist() == [0, 200, 0]  # through the back of the blue
    assert picture[height // 2, 3 * width // 4].tolist() == [200, 0, 0]
    assert extent == pytest.approx((0.0, 2.0, 0.0, 1.0), abs=0.01)
    slope = (
        points
        @ np.array([[0.5, 0.0, np.sqrt(0.75)], [0.0, 1.0, 0.0], [-np.sqrt(0.75), 0.0, 0.5]]).T
    )
    tilted, _ = cast(slope[:4], up, tones[:4])
    assert tilted[height // 2, tilted.shape[1] // 2, 1] == pytest.approx(
        200 * (AMBIENT + (1 - AMBIENT) * 0.5), abs=1
    )
    nothing, _ = cast(points, up[:, ::-1], tones)
    assert (nothing == BACKGROUND).all()


def test_the_report_of_a_map_shows_surface_and_layers(run, tmp_path):
    mapped = RunFolder.create(tmp_path / "map")
    for name in ("map.yaml", "map.pgm", "trajectory.txt", "truth/trajectory.txt"):
        mapped.write_bytes(name, run.path(name).read_bytes())
    rng = np.random.default_rng(0)
    clouds.save_ply(mapped.path("cloud.ply"), rng.uniform(size=(500, 3)) * (4.0, 3.0, 1.0))
    layer = rng.uniform(size=(30, 40))
    np.savez(mapped.path("layers.npz"), elevation=layer, slope=layer, traversability=layer,
             origin=np.zeros(2), resolution=np.array(0.1))  # fmt: skip
    mapped.write_json("summary.json", {"kind": "map", "name": "flat", "recording": "a b", "walkable_m2": 7.5,
                                       "skipped": 0, "frames": 9})  # fmt: skip
    text = write_report(mapped).read_text()
    shown = [name for name in Page(text).identities if name in (*ALL_PICTURES, "surface", "layers")]
    assert shown == ["map", "surface", "layers"]  # no pose error: the map has axes of its own
    assert "surefoot map &#x27;a b&#x27;" in text
    assert "7.5 m²" in text
    assert "Trajectory error" in text
    assert "highest surface below the headroom" in text
    assert "No colour image is registered to the depth: colour shows height" in text


def test_ground_beyond_the_grid_is_drawn_as_unknown(run):
    from surefoot.report.plots import top_view

    for drawn in (top_view.trajectory(run), top_view.grid_check(run)):
        assert drawn is not None
        assert drawn.figure.axes[0].get_facecolor()[:3] == top_view._UNSEEN


def test_the_report_of_a_panorama_lists_its_obstacles(tmp_path):
    made = RunFolder.create(tmp_path / "around")
    edges = {
        "left_rad": 0.5,
        "right_rad": 0.1,
        "distance_m": 1.234,
        "width_m": 0.4,
        "height_m": None,
        "left_edge_m": [1.2, 0.5],
        "right_edge_m": [1.2, 0.1],
    }
    made.write_json("panorama.json", {"views": [{"placed": True, "frame": 0}], "gaps": [],
                                      "obstacles": [{**edges, "sigma_distance_m": 0.05, "sigma_width_m": 0.0031}]})  # fmt: skip
    made.write_bytes("panorama_obstacles.png", cv2.imencode(".png", np.zeros((9, 9)))[1].tobytes())
    text = write_report(RunFolder.open(made.root)).read_text()
    page = Page(text)
    assert "panorama" in page.identities
    assert len(page.images) == 1
    assert "1.23 ± 0.05" in text
    assert "0.400 ± 0.003" in text
    assert "6 to 29" in text
    assert "unknown" in text
    assert "surefoot panorama RECORDING" in text
    assert "a panorama has no ground truth" in text
    assert "target met: panorama: share of the views placed" in text
    assert "1 of 1 targets" not in text
    assert "<code>panorama_obstacles.png</code>" in text


def test_the_report_of_a_monocular_run_shows_its_stages_and_iou(tmp_path):
    made = RunFolder.create(tmp_path / "mono")
    made.write_json("monocular.json", {"frames": 50, "judged": 50, "iou": 0.91, "iou_min": 0.7})
    for number in range(50):
        data = cv2.imencode(".png", np.full((9, 9), number))[1].tobytes()
        made.write_bytes(f"stages-{number:06d}.png", data)
    text = write_report(RunFolder.open(made.root)).read_text()
    assert 10 <= len(Page(text).images) <= 20
    assert "0.910" in text
    assert "surefoot monocular RECORDING" in text
    assert "<code>stages-*.png</code>" in text


def test_a_killed_run_has_a_report_and_is_measured_again_when_it_is_complete(tmp_path, undrawn):
    killed = RunFolder.create(tmp_path / "killed")
    poses = RowStream(killed, "trajectory_covariance.csv", COVARIANCE_HEADER)
    for t in (0.0, 1.0):
        poses.append(estimate_row(t, Gaussian(np.array([t, 0.0, 0.0]), np.eye(3))))
    saved = poses.__getstate__()  # writes the buffer
    text = write_report(RunFolder.open(killed.root)).read_text()
    assert "interrupted: this is its first part" in text
    poses.__setstate__(saved)
    poses.append(estimate_row(2.0, Gaussian(np.array([2.0, 0.0, 0.0]), np.eye(3))))
    poses.close()
    killed.write_planar_trajectory()
    killed.write_json("summary.json", {"kind": "recording"})
    text = write_report(killed).read_text()
    assert "interrupted" not in text
    assert killed.read_json("metrics.json")["path_m"] == 2.0


def test_text_from_files_is_escaped(run, tmp_path, undrawn):
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


def test_the_card_of_moving_obstacles_counts_them(run):
    assert "of 2 movers" in run.path("report.html").read_text()


def test_frames_that_compiled_are_not_in_the_plot_of_computing_time(run, tmp_path):
    slow = RunFolder(shutil.copytree(run.root, tmp_path / "slow"))
    lines = slow.path("timing.csv").read_text().splitlines()
    for number in (1, 60):
        stamp, _, *rest = lines[number].split(",")
        lines[number] = ",".join([stamp, "30000.0", *rest])
    slow.write_text("timing.csv", "\n".join(lines) + "\n")
    drawn = time_series.timing(slow)
    assert drawn is not None
    assert drawn.figure.axes[0].get_ylim()[1] < 200.0
    assert " ms (1)" in drawn.sentence


def test_the_views_start_where_they_show_most(run, tmp_path, undrawn):
    busy = RunFolder(shutil.copytree(run.root, tmp_path / "busy"))
    views = busy.read_json("views.json")
    flat = cv2.imencode(".jpg", np.zeros((288, 360, 3), np.uint8))[1].tobytes()
    for view in views:
        if view["stamp"] != views[4]["stamp"]:
            busy.write_bytes(view["file"], flat)
    text = write_report(busy).read_text()
    assert '<input id="instant" type="range" min="0" max="9" value="2"' in text
