"""The replay page in a browser: what moves, by mouse and keyboard, on a wide and a narrow screen, and without scripts."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from mapping.ground.surface import Border
from mapping.io import clouds, nav2
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, Pose3, head_rotation
from planning.gaze.selection import DirectionMap
from surefoot.cli.main import main
from surefoot.report.replay import gathering, page
from surefoot.report.replay.columns import columns
from surefoot.report.replay.entry import Entries
from surefoot.report.replay.figures import figures, nearest_obstacle
from surefoot.results.moment import UNKNOWN, Layers, Moment, Prediction, SurfaceSeen
from surefoot.results.moments import MomentWriter, held
from surefoot.results.run_folder import RunFolder

from .browser import CHROMIUM, Browser
from .replaying import go

STEP_M = 1 / 64
CELL_M = 0.05
SLOW_MPS = 0.1
WIDE, NARROW = 1300, 400


def moments(count: int = 60) -> list[Moment]:
    """A robot walks along x at `SLOW_MPS` past a box at (1, 0.5) and towards a mover, looking left and right."""
    rng = np.random.default_rng(0)
    camera = Camera.from_view(32, 24, math.radians(60), math.radians(45))
    made = []
    for k in range(count):
        stamp, x = 100.0 + 0.3 * k, 0.03 * k
        pan = 0.5 * math.sin(0.4 * k)
        T = Pose2(x, 0.0, 0.0).lifted() @ Pose3.from_rotation(head_rotation(pan, 0.5), np.array([0.0, 0.0, 0.4]))  # fmt: skip
        mover = Obstacle(Gaussian(np.array([2.0 - 0.02 * k, -0.5, -0.07, 0.0]), 0.01 * np.eye(4)), 0.1, 0.4, 3, 0.9, stamp)  # fmt: skip
        ahead = Prediction(2.0, 0.8, mover.position + 2 * mover.velocity, 0.05 * np.eye(2))
        grid = None
        if k % 2 == 0:
            origin = np.round(np.array([x, 0.0]) / CELL_M) * CELL_M - 1.0
            probability = np.full((40, 40), 10, np.uint8)
            probability[:4] = UNKNOWN
            row, column = np.floor((np.array([0.5, 1.0]) - origin[::-1]) / CELL_M).astype(int)
            if 0 <= column < 40:
                probability[row, column] = 250
            grid = Layers(origin, CELL_M, probability, np.full((40, 40), 200, np.uint8), np.zeros((40, 40), np.float32))  # fmt: skip
        picture = np.full((60, 80, 3), (20, 40, 4 * k % 256), np.uint8)
        gaze = rng.integers(0, 255, (9, 5)).astype(np.uint8)
        made.append(
            Moment(
                stamp,
                Gaussian(np.array([x, 0.0, 0.1]), np.diag([1e-4, 4e-4, 1e-4])),
                {"tof": T},
                {"tof": camera},
                head=(pan, 0.5),
                feet=np.array([[x, 0.04, 0.0, k % 2], [x + 0.05, -0.04, 0.0, 1 - k % 2]]),
                steps=np.array([[x + 0.05, 0.0, 0.0], [x + 0.1, 0.0, 0.0]]),
                route=np.array([[x, 0.0], [2.5, 0.0]]),
                goal=np.array([2.5, 0.0]),
                gaze=(pan, 0.5),
                gaze_map=DirectionMap(
                    gaze / 255.0, np.linspace(-1.5, 1.5, 9), np.linspace(0.0, 1.0, 5)
                ),
                why="walk" if k % 3 else "guard",
                risk=0.01 * k,
                grid=grid,
                tracks=(mover,),
                predictions=((ahead,),),
                timing_ms={"total": 40.0 + k},
                colour=cv2.imencode(".webp", picture)[1].tobytes(),
                depth=np.full((24, 32), 1 + k, np.uint8),
                depth_step_m=STEP_M,
                depth_sensor="tof",
            )
        )
    return made


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A simulated walk with its page, from `moments`."""
    folder = RunFolder.create(tmp_path_factory.mktemp("replay") / "walk")
    folder.write_json(
        "summary.json", {"kind": "simulation", "name": "walk", "goal_positions": [[2.5, 0.0]]}
    )
    text = page.replay_page(folder, moments())
    assert text is not None
    folder.write_text(page.REPLAY, text)
    return folder


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no chromium on the PATH: the page was not rendered; apt-get install chromium")
    with Browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


def opened(browser: Browser, run: RunFolder, width: int = WIDE, fragment: str = "") -> Browser:
    browser.open(run.path(page.REPLAY), width, fragment=fragment)
    browser.wait("document.documentElement.dataset.ready === '1'")
    return browser


def drawn(browser: Browser) -> dict[str, str]:
    """What each pane shows: its pixels, or its words."""
    script = """JSON.stringify(Object.fromEntries([
      ...[...document.querySelectorAll('#map, #pictures canvas, #plots canvas')].map((c, k) => [c.id || 'canvas ' + k, c.toDataURL()]),
      ['values', document.getElementById('values').textContent],
      ['clock', document.getElementById('clock').textContent],
      ['space', document.getElementById('space').dataset.moment || ''],
    ]))"""
    return dict(json.loads(browser.run(script)))


@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_the_slider_moves_every_pane(browser, run, width):
    opened(browser, run, width)
    browser.run("document.getElementById('space').scrollIntoView()")
    go(browser, 5)
    browser.wait("document.getElementById('space').dataset.moment === '5'")
    before = drawn(browser)
    go(browser, 40)
    browser.wait("document.getElementById('space').dataset.moment === '40'")
    after = drawn(browser)
    assert len(before) == 4 + 3 + 7  # map, values, clock, space; camera, depth, gaze; time series
    assert [name for name in before if before[name] == after[name]] == []
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.errors == []
    outside = [url for url in browser.requests if not url.startswith(("file:", "data:", "blob:"))]
    assert outside == []


def test_no_picture_of_a_later_moment_is_shown(browser, tmp_path):
    folder = RunFolder.create(tmp_path / "late")
    made = moments(8)
    bare = [replace(one, colour=None, depth=None, gaze_map=None) for one in made[:3]]
    bare[0] = replace(bare[0], head=(-1.1e-16, 0.5))
    folder.write_text(page.REPLAY, page.replay_page(folder, bare + made[3:]) or "")
    opened(browser, folder)
    said = """(() => [[...document.querySelectorAll('#pictures output')].map((one) => one.textContent),
        [...document.querySelectorAll('#pictures canvas')].map((c) => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some((v) => v))])()"""
    for moment, ink in ((0, False), (4, True), (1, False)):
        go(browser, moment)
        captions, inked = json.loads(browser.run(f"JSON.stringify({said})"))
        assert [caption == "none yet" for caption in captions] == [not ink] * 3
        assert inked == [ink] * 3
    assert browser.errors == []
    go(browser, 0)
    assert "e-1" not in browser.run("document.getElementById('plots').textContent")


def test_a_request_of_the_page_would_be_refused(browser, run, tmp_path):
    text = (
        run.path(page.REPLAY)
        .read_text()
        .replace("<main>", '<main><img src="http://outside.invalid/x.png">')
    )
    (tmp_path / "sly.html").write_text(text)
    browser.open(tmp_path / "sly.html", WIDE)
    browser.wait("document.documentElement.dataset.ready === '1'")
    assert any("Content Security Policy" in error for error in browser.errors)


def test_the_robot_is_drawn_where_the_moment_has_it(browser, run):
    opened(browser, run)
    go(browser, 40)  # x = 1.2 m
    words = browser.run("document.getElementById('values').textContent")
    assert "1.20, 0.00 m ± 2.0 cm" in words
    found = []
    for moment in (0, 40):
        go(browser, moment)
        # mean column of the blue pixels of the robot's outline and arrow, which the grey path has not
        found.append(
            browser.run(
                """(() => { const c = document.getElementById('map'), w = c.width, d = c.getContext('2d').getImageData(0, 0, w, c.height).data;
                let right = 0; for (let k = 0; k < d.length; k += 4) if (d[k] < 30 && d[k + 1] > 90 && d[k + 1] < 140 && d[k + 2] > 150) right = Math.max(right, (k / 4) % w);
                return right; })()"""
            )
        )
    scale = float(browser.run("document.getElementById('map').dataset.scale"))
    assert (found[1] - found[0]) / scale == pytest.approx(1.2, abs=0.03)


def levels(count: int = 20) -> list[Moment]:
    """A robot that climbs a step of 0.1 m; the upper surface, an L, is seen from the middle of the walk on."""
    square = np.array([[-1.0, -1.0, 0.0], [0.5, -1.0, 0.0], [0.5, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    lower = SurfaceSeen(
        square, np.array([Border.UNSEEN, Border.RISE, Border.UNSEEN, Border.UNSEEN])
    )
    upper = SurfaceSeen(RING, np.full(len(RING), Border.DROP))
    made = []
    for k, one in enumerate(moments(count)):
        up = 0.1 if k >= count // 2 else 0.0
        seen = {0: (lower,), count // 2: (lower, upper)}.get(k)
        made.append(
            replace(
                one, grid=None, tracks=(), predictions=(), surfaces=seen,
                heights_m=np.array([up, up, up]), height_sigma_m=0.004,
            )
        )  # fmt: skip
    return made


RING = np.array(
    [[0.5, -1.0, 0.1], [2.0, -1.0, 0.1], [2.0, 0.0, 0.1], [1.0, 0.0, 0.1], [1.0, 1.0, 0.1], [0.5, 1.0, 0.1]]
)  # fmt: skip


@pytest.fixture(scope="module")
def climb(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = RunFolder.create(tmp_path_factory.mktemp("replay") / "climb")
    folder.write_json("summary.json", {"kind": "simulation", "name": "climb"})
    text = page.replay_page(folder, levels())
    assert text is not None
    folder.write_text(page.REPLAY, text)
    return folder


DROPPING = """(() => {
  const c = document.getElementById('map'), data = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  const [r, g, b] = rgb(theme.moving);
  let count = 0;
  for (let k = 0; k < data.length; k += 4) count += Math.max(Math.abs(data[k] - r), Math.abs(data[k + 1] - g), Math.abs(data[k + 2] - b)) < 40;
  return count;
})()"""
"""Pixels of the top view in the colour of sides beyond which it drops."""


def test_surfaces_of_several_levels_are_drawn_from_when_they_are_seen(browser, climb):
    opened(browser, climb)
    dropping = []
    for k in (9, 10):
        go(browser, k)
        dropping.append(browser.run(DROPPING))
        assert ("10.0 ± 0.4 cm above" in drawn(browser)["values"]) == (k == 10)
    scale = float(browser.run("document.getElementById('map').dataset.scale"))
    round_m = float(np.linalg.norm(np.roll(RING, -1, axis=0) - RING, axis=1).sum())
    assert dropping[0] == 0
    assert 0.5 < dropping[1] / (2.0 * round_m * scale) < 2.0  # lines are two pixels wide
    assert "it drops beyond this side" in browser.run(
        "document.getElementById('legend').textContent"
    )
    assert browser.errors == []


def test_a_live_page_gets_surfaces_once_and_heights_always(climb):
    entries = Entries(climb)
    sent = [entries.of(one) for one in held(levels(12))]
    assert [k for k, one in enumerate(sent) if one["surfaces"]] == [0, 6]
    assert len(sent[6]["surfaces"]["of"][0]) == 2
    assert [one["heights"][0][0] for one in sent] == [0.0] * 6 + [0.1] * 6


def test_a_concave_surface_is_cut_into_triangles_that_cover_it_once(browser, climb):
    opened(browser, climb)
    ring = json.dumps(RING.tolist())
    cut = np.array(json.loads(browser.run(f"JSON.stringify(triangles({ring}))")))
    assert len(cut) == len(RING) - 2
    a, b, c = (RING[cut[:, k], :2] for k in range(3))
    (u, v), (w, z) = (b - a).T, (c - a).T
    areas = (u * z - v * w) / 2.0
    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(1.5 + 0.5)
    asked = [[1.8, -0.8], [1.8, 0.8], [0.7, 0.9]]
    found = [browser.run(f"inside({ring}, {x}, {y})") for x, y in asked]
    assert found == [True, False, True]


def test_keys_step_jump_and_play(browser, run):
    opened(browser, run)
    shown = "Number(document.getElementById('instant').value)"
    browser.run("document.activeElement.blur()")
    browser.press("ArrowRight")
    assert browser.run(shown) == 1
    browser.press("ArrowRight", shift=True)
    assert browser.run(shown) == 11
    browser.press("ArrowLeft")
    assert browser.run(shown) == 10
    browser.press("End")
    assert browser.run(shown) == 59
    browser.press("Home")
    assert browser.run(shown) == 0
    browser.run("document.getElementById('speed').value = '10'")
    browser.press("Space")
    browser.wait(f"{shown} > 4")
    assert browser.run("document.getElementById('play').getAttribute('aria-label')") == "pause"
    browser.press("Space")
    assert browser.run("document.getElementById('play').getAttribute('aria-label')") == "play"
    stopped = browser.run(shown)
    browser.run("new Promise((done) => setTimeout(done, 200))")
    assert browser.run(shown) == stopped
    assert re.fullmatch(r"[0-9.]+ s, (walk|guard)", browser.run("document.getElementById('instant').getAttribute('aria-valuetext')"))  # fmt: skip


def test_a_link_and_a_click_in_a_plot_go_to_their_time(browser, run):
    opened(browser, run, fragment="#t=9.05")
    assert browser.run("document.documentElement.dataset.drawn") == "30"  # 9.0 s
    browser.run("document.querySelector('#plots canvas').scrollIntoView({block: 'center'})")
    box = json.loads(
        browser.run(
            "JSON.stringify(document.querySelector('#plots canvas').getBoundingClientRect())"
        )
    )
    browser.click(
        box["left"] + 44 + (box["width"] - 52) / 3, box["top"] + 40
    )  # a third of the time axis
    browser.wait("document.documentElement.dataset.drawn === '19'")  # 17.7 s / 3 = 5.9 s


def test_the_pointer_over_a_depth_picture_tells_its_metres(browser, run):
    opened(browser, run)
    go(browser, 40)
    script = """(() => { const section = [...document.querySelectorAll('#pictures section')].find((s) => s.textContent.startsWith('Depth'));
      const canvas = section.querySelector('canvas'), box = canvas.getBoundingClientRect();
      canvas.dispatchEvent(new PointerEvent('pointermove', { clientX: box.left + 9, clientY: box.top + 9 }));
      return section.querySelector('output').textContent; })()"""
    assert browser.run(script) == f"{41 * STEP_M:.2f} m"


def test_without_webgl_the_page_has_no_pane_in_space(browser, run):
    script = "HTMLCanvasElement.prototype.getContext = new Proxy(HTMLCanvasElement.prototype.getContext, "
    script += "{ apply: (f, c, a) => a[0] === 'webgl2' ? null : Reflect.apply(f, c, a) });"
    added = browser.ask("Page.addScriptToEvaluateOnNewDocument", {"source": script})
    opened(browser, run)
    go(browser, 40)
    assert browser.run("document.getElementById('space-pane').hidden")
    assert browser.errors == []
    browser.ask("Page.removeScriptToEvaluateOnNewDocument", {"identifier": added["identifier"]})


def mapped(root: Path) -> RunFolder:
    """A map as `surefoot map` leaves it."""
    folder = RunFolder.create(root)
    rng = np.random.default_rng(2)
    cells = np.ones((60, 80), np.float32)
    nav2.save(folder.root, "map", cells * 0.1, np.ones(cells.shape, bool), np.array([-1.0, -1.5]), 0.05)  # fmt: skip
    np.savez(folder.path("layers.npz"), elevation=cells * 0.01, slope=cells, traversability=rng.uniform(size=cells.shape),
             origin=np.array([-1.0, -1.5]), resolution=np.array(0.05))  # fmt: skip
    cloud = rng.uniform(size=(3000, 3)) * (4.0, 3.0, 1.0) - (1.0, 1.5, 0.0)
    clouds.save_ply(folder.path("cloud.ply"), cloud, rng.integers(0, 255, (3000, 3)).astype(np.uint8))  # fmt: skip
    folder.write_json("summary.json", {"kind": "map", "name": "flat", "trajectory": "camera"})
    return folder


def panorama(root: Path) -> RunFolder:
    """A panorama as `surefoot panorama` leaves it."""
    folder = RunFolder.create(root)
    cloud = np.random.default_rng(3).uniform(size=(900, 3)) * (2.0, 2.0, 0.5)
    clouds.save_ply(folder.path("panorama.ply"), cloud)
    box = {"left_edge_m": [1.0, 0.4], "right_edge_m": [1.0, -0.1], "left_rad": 0.38, "right_rad": -0.1}  # fmt: skip
    gap = {"left_rad": 0.9, "right_rad": 0.38, "distance_m": 1.0}
    folder.write_json("panorama.json", {"views": [], "obstacles": [box], "gaps": [gap]})
    picture = cv2.imencode(".png", np.full((60, 200, 3), 90, np.uint8))[1].tobytes()
    folder.write_bytes("panorama_obstacles.png", picture)
    folder.write_json("summary.json", {"kind": "panorama", "name": "round"})
    return folder


@pytest.mark.parametrize("width", [WIDE, NARROW])
@pytest.mark.parametrize(
    ("made", "panes", "clock"),
    [(mapped, ["Camera", "Depth (tof)"], "3.6 / 8.7 s"),
     (panorama, ["Camera", "Depth (tof)", "Panorama of all views"], "view 13 of 30")],
)  # fmt: skip
def test_maps_and_panoramas_replay_their_cameras(browser, tmp_path, made, panes, clock, width):
    folder = made(tmp_path / "run")
    keep = ("stamp_s", "cameras", "lenses", "colour", "depth", "depth_step_m", "depth_sensor")
    text = page.replay_page(
        folder, [Moment(**{key: getattr(one, key) for key in keep}) for one in moments(30)]
    )
    assert text is not None
    folder.write_text(page.REPLAY, text)
    opened(browser, folder, width)
    go(browser, 2)
    before = drawn(browser)
    go(browser, 12)
    after = drawn(browser)
    assert after["clock"] == clock
    assert before["map"] != after["map"]
    titles = (
        "JSON.stringify([...document.querySelectorAll('#pictures h2')].map((h) => h.textContent))"
    )
    assert json.loads(browser.run(titles)) == panes
    hidden = "document.getElementById('plots-pane').hidden && document.getElementById('now').hidden"
    assert browser.run(hidden)  # a camera alone has neither figures nor time series
    said = browser.run("document.querySelector('main').textContent")
    assert "Not in this run: pose of a body; grid around the robot; tracked obstacles; plan" in said
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.errors == []


@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_without_scripts_the_page_shows_pictures_of_the_run(browser, run, width):
    browser.ask("Emulation.setScriptExecutionDisabled", {"value": True})
    browser.open(run.path(page.REPLAY), width)
    tree = browser.ask("DOMSnapshot.captureSnapshot", {"computedStyles": ["visibility"]})
    words = tree["strings"]
    shown = tree["documents"][0]["layout"]
    texts = " ".join(words[k] for k in shown["text"] if k >= 0)
    names = [words[tree["documents"][0]["nodes"]["nodeName"][k]] for k in shown["nodeIndex"]]
    browser.ask("Emulation.setScriptExecutionDisabled", {"value": False})
    assert "The run in pictures" in texts
    assert "Camera, " in texts
    assert names.count("IMG") >= 12  # six of each sensor
    assert "CANVAS" not in names


def test_a_page_of_too_many_pictures_keeps_some_of_the_whole_run(run, monkeypatch):
    noise = np.random.default_rng(1).integers(0, 255, 40_000, np.uint8).tobytes()
    many = [dataclasses.replace(one, colour=noise[k:]) for k, one in enumerate(moments(50))]
    monkeypatch.setattr(page, "LARGEST_BYTES", 900_000)
    text = page.replay_page(run, many)
    assert text is not None
    assert len(text) <= 900_000
    packed = json.loads(re.findall(r'id="packed">(.*?)</script>', text)[0])
    pictures = next(one for one in packed["pictures"] if len(one[0]) > 30_000)
    assert 3 <= len(pictures) < 25


def test_a_long_run_is_thinned_evenly(monkeypatch):
    monkeypatch.setattr(gathering, "MOST_MOMENTS", 10)
    long = [Moment(float(k)) for k in range(1000)]
    kept = [one.stamp_s for one in gathering.gather(long).moments]
    assert 10 <= len(kept) < 20
    assert len(set(np.diff(kept))) == 1
    assert kept[-1] > 900


def test_the_nearest_obstacle_is_the_nearest_cell_or_track():
    made = moments(40)
    grids = gathering.gather(made).grids
    found = nearest_obstacle(made, grids)
    x = 0.03 * 30
    cell = math.hypot(1.025 - x, 0.525)  # the cell that holds (1, 0.5)
    track = math.hypot(2.0 - 0.02 * 30 - x, 0.5) - 0.1
    assert found[30] == pytest.approx(min(cell, track), abs=CELL_M / 2)
    assert nearest_obstacle([Moment(0.0)], []) == [None]


def test_the_page_gets_the_numbers_of_the_moments():
    content = columns(moments(3))
    assert content["t"] == [0.0, 0.3, 0.6]
    assert content["pose"][2][:3] == [0.06, 0.0, 0.1]
    assert content["pose"][2][3:] == [1e-4, 0.0, 4e-4, 1e-4]
    left, right, top, bottom = content["cameras"][0]["slopes"]
    assert (left, right) == pytest.approx(
        (-math.tan(math.radians(30)), math.tan(math.radians(30))), rel=0.1
    )
    assert (top, bottom) == pytest.approx(
        (-math.tan(math.radians(22.5)), math.tan(math.radians(22.5))), rel=0.1
    )
    assert content["tracks"][1][0]["id"] == 3


def test_a_run_without_estimates_is_refused_with_a_reason(tmp_path):
    bare = RunFolder.create(tmp_path / "old")
    bare.write_json("summary.json", {"kind": "recording"})
    result = CliRunner().invoke(main, ["replay", str(bare.root)])
    assert result.exit_code != 0
    assert "estimates.mcap" in str(
        result.exception if isinstance(result.exception, InputError) else result.output
    )


def test_text_from_files_is_escaped(tmp_path):
    sly = RunFolder.create(tmp_path / "sly")
    sly.write_json("summary.json", {"kind": "simulation", "name": "<script>alert(1)</script>"})
    named = [
        dataclasses.replace(one, why="</script><script>alert(2)</script>") for one in moments(2)
    ]
    text = page.replay_page(sly, named)
    assert text is not None
    assert "alert" not in text.replace("&lt;script&gt;alert(1)", "")


def test_a_killed_run_is_replayed_as_far_as_it_was_written(tmp_path):
    killed = RunFolder.create(tmp_path / "killed")
    killed.write_json("summary.json", {"kind": "simulation", "interrupted": True})
    writer = MomentWriter(killed)
    for one in moments(20):
        writer.write(one)
    made = page.write_replay(killed)  # never closed
    assert made is not None
    found = re.search(r": ([0-9]+) moments in", made.read_text())
    assert found is not None
    assert 10 <= int(found.group(1)) <= 20


def test_one_moment_is_one_moment(tmp_path):
    made = RunFolder.create(tmp_path / "short")
    writer = MomentWriter(made)
    writer.write(moments(1)[0])
    writer.close(())
    shown = page.write_replay(made)
    assert shown is not None
    assert ": 1 moment in 0.0 s." in shown.read_text()


def test_numbers_that_are_not_finite_are_left_out(tmp_path):
    strange = moments(4)
    lost = Gaussian(np.array([0.0, 0.0, 0.0]), np.diag([np.inf, np.inf, np.inf]))
    strange[1] = dataclasses.replace(strange[1], pose=lost, risk=math.inf)
    text = page.replay_page(RunFolder.create(tmp_path / "strange"), strange)
    assert text is not None
    assert columns(strange)["pose"][1][3:] == [None, 0.0, None, None]


def test_a_heading_and_a_place_of_nothing_have_no_sign():
    nearly = Gaussian(np.array([-1e-4, -1e-4, -1e-3]), 1e-6 * np.eye(3))
    words = dict(figures([Moment(stamp_s=0.0, pose=nearly)], [])[0])
    assert words["heading"][0].startswith("0° ±")
    assert words["position"][0].startswith("0.00, 0.00 m")
