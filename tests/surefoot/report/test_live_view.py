"""The live page: a walk in the browser while it goes on, and what pages may and may not do to it."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from perception.primitives.errors import InputError
from surefoot.cli import run_verbs
from surefoot.cli.main import main
from surefoot.config.load import load
from surefoot.report import live_view
from surefoot.report.live_server import LiveServer
from surefoot.report.live_view import LivePage
from surefoot.results.moment import Moment
from surefoot.results.moments import MomentWriter, read_moments
from surefoot.results.run_folder import RunFolder
from surefoot.run.simulate import simulate

from .browser import CHROMIUM, Browser

SETTINGS = ("mission.time_limit_s=3",)
SAME = (
    "trajectory_covariance.csv",
    "commands.csv",
    "floor.csv",
    "obstacles.json",
    "odometry.csv",
    "map.pgm",
)
SHOWN = "Number(document.documentElement.dataset.drawn)"
NEWEST = "Number(document.getElementById('instant').max)"


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """The first steps of a walk that nobody watched."""
    out = tmp_path_factory.mktemp("walk") / "alone"
    config = load(None, SETTINGS, scene="boxes", seed=4)
    return RunFolder(simulate(config, out, False, lambda text: None).folder)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no chromium on the PATH: the page was not rendered; apt-get install chromium")
    with Browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    for name in ("EVERY_S", "PATIENCE_S", "LOOK_S"):
        monkeypatch.setattr(live_view, name, 0.02)


@pytest.fixture
def page() -> Iterator[LivePage]:
    made = LivePage()
    yield made
    made.close()


def ask(
    page: LivePage, path: str, values: dict[str, Any] | None = None, **headers: str
) -> tuple[int, bytes]:
    """Status and answer of the page's server; a command if there are values."""
    connection = http.client.HTTPConnection("127.0.0.1", int(page.address.split(":")[2].strip("/")))
    kind = {} if values is None else {"Content-Type": "application/json"}
    body = None if values is None else json.dumps(values)
    connection.request("GET" if values is None else "POST", path, body, {**kind, **headers})
    answer = connection.getresponse()
    return answer.status, answer.read()


def news(page: LivePage, number: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """State of the run and its moments from a number on, as a page gets them."""
    answer = json.loads(ask(page, f"/moments?from={number}")[1])
    return answer["state"], answer["moments"]


def everything(page: LivePage) -> list[dict[str, Any]]:
    """All moments of a run, when it is over."""
    found: list[dict[str, Any]] = []
    over = False
    while not over:
        state, more = news(page, len(found))
        over = state["over"]
        found += more
    assert not state["error"]
    return found


def walked(page: LivePage, run: RunFolder) -> threading.Thread:
    """Shows the moments of a run as its walk did, in a thread."""
    made = list(read_moments(run))

    def steps() -> None:
        for one in made:
            page.show(one, lambda: False)
        page.finish()

    page.watch(run)
    thread = threading.Thread(target=steps, daemon=True)
    thread.start()
    return thread


def space(browser: Browser, tmp_path: Path) -> np.ndarray:
    """The pixels of the pane in space, RGB."""
    box = json.loads(
        browser.run("JSON.stringify(document.getElementById('space').getBoundingClientRect())")
    )
    browser.screenshot(tmp_path / "space.png", whole=False)
    picture = cv2.imread(str(tmp_path / "space.png"))
    assert picture is not None
    left, top = round(box["left"]), round(box["top"])
    return picture[
        top : top + round(box["height"]), left : left + round(box["width"]), ::-1
    ].astype(int)


def blue(picture: np.ndarray) -> np.ndarray:
    """Pixels in the blue of the robot."""
    r, g, b = np.moveaxis(picture, -1, 0)
    return (b > 1.25 * g) & (b > 1.9 * r) & (b > 90)


@pytest.mark.parametrize("width", [1300, 400])
def test_a_walk_is_seen_from_its_first_moment_on(browser, page, walk, tmp_path, width):
    page.watch(walk)
    made = list(read_moments(walk))
    page.show(made[0], lambda: False)
    browser.open(page.address.replace("localhost", "127.0.0.1"), width)
    browser.wait("document.documentElement.dataset.ready === '1'")
    browser.wait("document.getElementById('space').dataset.moment === '0'")
    first = space(browser, tmp_path)
    assert blue(first).sum() > 200  # the robot
    background = np.abs(first - first[2, 2]).max(axis=-1) < 12
    assert (~background).mean() > 0.1
    assert len(np.unique(first[~background] // 48, axis=0)) > 12  # what its camera sees of the room
    for one in made[1:]:
        page.show(one, lambda: False)
    browser.wait(f"document.getElementById('space').dataset.moment === '{len(made) - 1}'")
    later = space(browser, tmp_path)
    assert (np.abs(first - later).max(axis=-1) > 24).mean() > 0.05
    assert browser.run("document.documentElement.scrollWidth") <= width
    titles = (
        "JSON.stringify([...document.querySelectorAll('#pictures h2')].map((h) => h.textContent))"
    )
    assert {"Camera", "Depth (tof)"} <= set(json.loads(browser.run(titles)))
    assert browser.errors == []


def test_pause_holds_the_walk_step_moves_it_by_one_and_the_slider_goes_back(browser, page, walk):
    page.watch(walk)
    made = list(read_moments(walk))
    page.show(made[0], lambda: False)
    browser.open(page.address.replace("localhost", "127.0.0.1"), 1300)
    browser.wait("document.documentElement.dataset.ready === '1'")
    browser.run("document.getElementById('play').click()")
    browser.wait("document.documentElement.dataset.state === 'The walk is paused.'")
    while not news(page, 0)[0]["paused"]:
        pass
    thread = threading.Thread(
        target=lambda: [page.show(one, lambda: False) for one in made[1:]], daemon=True
    )
    thread.start()
    browser.wait(f"{NEWEST} === 1")  # the one that was computed when the walk was paused
    browser.run("new Promise((done) => setTimeout(done, 400))")
    assert browser.run(f"{NEWEST}") == 1
    assert browser.run(SHOWN) == 0
    browser.press("ArrowRight")
    browser.wait(f"{SHOWN} === 1")
    browser.run("document.getElementById('step').click()")
    browser.wait(f"{SHOWN} === 2")
    browser.run("new Promise((done) => setTimeout(done, 400))")
    assert browser.run(NEWEST) == 2
    browser.press("Home")
    browser.wait(f"{SHOWN} === 0")
    browser.run("document.getElementById('newest').click()")
    browser.wait(f"{SHOWN} === {len(made) - 1}")  # it goes on, and the page with it
    thread.join(10.0)
    page.finish()
    browser.wait("document.documentElement.dataset.state.startsWith('The run is over')")
    browser.run("(() => { const s = document.getElementById('instant'); s.value = 3; s.dispatchEvent(new Event('input')); })()")  # fmt: skip
    browser.wait(f"{SHOWN} === 3")
    assert browser.errors == []


def test_a_walk_that_is_watched_and_paused_gives_the_same_bits(walk, tmp_path, monkeypatch):
    held: list[int] = []
    found: list[dict[str, Any]] = []
    shows = [0, 0]  # begun, over
    show = LivePage.show

    def counted(page: LivePage, moment: Moment, stopped: Callable[[], bool]) -> None:
        shows[0] += 1
        show(page, moment, stopped)
        shows[1] += 1

    def watch(page: LivePage) -> None:
        while len(found) < 4:
            found.extend(news(page, len(found))[1])
        ask(page, "/walk", {"paused": True})
        waits = 0
        while waits < 5:  # the frame that is being computed still comes
            found.extend(news(page, len(found))[1])
            waits = waits + 1 if shows[0] == len(found) > shows[1] else 0
        held.append(len(found))
        held.append(len(found) + len(news(page, len(found))[1]))
        ask(page, "/walk", {"step": True})
        while len(found) < held[1] + 1:
            found.extend(news(page, len(found))[1])
        ask(page, "/walk", {"paused": False, "speed": 20.0})
        found.extend(everything(page)[len(found) :])

    threads: list[threading.Thread] = []

    def opened(address: str) -> None:
        threads.append(threading.Thread(target=watch, args=(pages[0],), daemon=True))
        threads[0].start()

    pages: list[LivePage] = []
    make = LivePage.__init__
    monkeypatch.setattr(LivePage, "__init__", lambda page: (pages.append(page), make(page))[1])
    monkeypatch.setattr(LivePage, "show", counted)
    monkeypatch.setattr(LivePage, "stay", lambda page: threads[0].join(20.0))  # until Ctrl-C
    monkeypatch.setattr(run_verbs, "open_in_browser", opened)
    words = ["simulate", "boxes", "--seed", "4", "--view", "--set", SETTINGS[0], "--out", str(tmp_path / "watched")]  # fmt: skip
    result = CliRunner().invoke(main, words)
    assert "shows the whole walk until Ctrl-C" in result.stderr
    assert held[0] == held[1] >= 4
    other = RunFolder(tmp_path / "watched")
    for name in SAME:
        assert other.path(name).read_bytes() == walk.path(name).read_bytes(), name
    assert [one["pose"] for one in found] == [one["pose"] for one in shown(walk)]
    pages[0].close()


def shown(run: RunFolder) -> list[dict[str, Any]]:
    """What a page shows of a run folder."""
    page = LivePage()
    page.follow(run)
    found = everything(page)
    page.close()
    return found


def test_a_walk_and_its_run_folder_show_the_same(page, walk):
    walked(page, walk).join(10.0)
    live = everything(page)
    assert len(live) == len(list(read_moments(walk)))
    assert live == shown(walk)


def test_a_folder_is_followed_while_it_is_written(page, walk, tmp_path):
    made = [replace(one, stamp_s=5.0 * k) for k, one in enumerate(read_moments(walk))]
    folder = RunFolder.create(tmp_path / "written")
    writer = MomentWriter(folder)
    page.follow(folder)
    found: list[dict[str, Any]] = []
    for k, one in enumerate(made):
        writer.write(one)
        while len(found) < k:  # the newest comes with the next one or the end
            state, more = news(page, len(found))
            found += more
            assert not state["over"]
    writer.close(())
    assert [one["t"] for one in everything(page)] == [[one.stamp_s] for one in made]


def test_a_run_whose_writer_was_killed_is_shown_to_its_last_whole_part(page, walk, tmp_path):
    folder = RunFolder.create(tmp_path / "killed")
    for name in (".surefoot-run", "config.toml"):
        folder.path(name).write_bytes(walk.path(name).read_bytes())
    data = walk.path("estimates.mcap").read_bytes()
    folder.path("estimates.mcap").write_bytes(data[: len(data) * 2 // 3])
    del folder  # it is not being written any more
    page.follow(RunFolder(tmp_path / "killed"))
    assert 1 < len(everything(page)) < len(list(read_moments(walk)))


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8080",
        "localhost.evil.example",
        "0.0.0.0",
        "",
        "[",
        "a@localhost",
        "localhost@a:1",
        "localhost:80@evil.example",
        "localhost:",
        "localhost:80:80",
        "localhost, evil.example",
    ],
)
def test_a_name_that_was_bound_to_this_machine_gets_no_answer(page, host):
    assert ask(page, "/", Host=host)[0] == 403
    assert ask(page, "/moments?from=0", Host=host)[0] == 403
    assert ask(page, "/walk", {"paused": True}, Host=host)[0] == 403
    assert not news(page, 0)[0]["paused"]


def test_a_request_with_two_names_gets_no_answer(page):
    connection = http.client.HTTPConnection("127.0.0.1", int(page.address.split(":")[2].strip("/")))
    connection.putrequest("GET", "/", skip_host=True)
    for host in ("localhost", "evil.example"):
        connection.putheader("Host", host)
    connection.endheaders()
    assert connection.getresponse().status == 403


def test_many_connections_wait_for_an_answer():
    server = LiveServer("", lambda number: b"", lambda values: None, port=0)  # accepts none yet
    address = ("127.0.0.1", server.server_port)
    with contextlib.ExitStack() as stack:
        stack.callback(server.server_close)
        for _ in range(100):
            stack.enter_context(socket.create_connection(address, timeout=5.0))


@pytest.mark.parametrize("error", [OSError("the disk is gone"), ValueError("nan")])
def test_a_page_says_why_its_moments_ended(page, walk, monkeypatch, error):
    def fails(entries: live_view.Entries, moment: Moment) -> None:
        raise error

    monkeypatch.setattr(live_view.Entries, "of", fails)
    page.follow(walk)
    state = {"over": False}
    for _ in range(500):
        if state["over"]:
            break
        state, _ = news(page, 0)
    assert state["over"]
    assert state["error"] == f"unexpected {type(error).__name__}: {error}"


@pytest.mark.parametrize("host", ["localhost:9000", "127.0.0.1:8080", "localhost"])
def test_its_own_names_are_answered_on_any_port(page, host):
    status, text = ask(page, "/", Host=host)
    assert status == 200
    assert b"data-live" in text


def test_another_site_cannot_command_the_walk(page):
    assert ask(page, "/walk", {"paused": True}, Origin="http://evil.example")[0] == 403
    assert ask(page, "/walk", {"paused": True}, **{"Content-Type": "text/plain"})[0] == 400
    assert ask(page, "/walk", {"speed": 0.0})[0] == 400
    assert ask(page, "/walk", {"speed": "fast"})[0] == 400
    assert ask(page, "/walk", [])[0] == 400
    assert ask(page, "/walk", {"speed": 10**20})[0] == 400
    assert ask(page, "/walk", {}, **{"Content-Length": "\u00b2"})[0] == 400
    assert ask(page, "/moments?from=-1")[0] == 400
    assert ask(page, "/moments?from=%C2%B2")[0] == 400
    assert ask(page, "//[")[0] in (400, 404)  # newer servers of Python take it for the path /[
    assert ask(page, "/estimates.mcap")[0] == 404
    assert not news(page, 0)[0]["paused"]


def test_a_walk_does_not_wait_for_a_page_that_is_closed(page, walk):
    assert ask(page, "/walk", {"paused": True})[0] == 200
    thread = walked(page, walk)
    thread.join(20.0)  # no page ever asked for news
    assert not thread.is_alive()


def test_a_closed_page_leaves_no_thread(walk):
    before = set(threading.enumerate())
    page = LivePage()
    page.watch(walk)
    page.show(
        next(iter(read_moments(walk))), lambda: False
    )  # and the walk never says that it is over
    page.close()
    for thread in set(threading.enumerate()) - before:
        thread.join(5.0)
    assert set(threading.enumerate()) <= before


def test_a_stopped_walk_does_not_wait(page, walk):
    page.watch(walk)
    assert news(page, 0)[1] == []  # a page is open
    ask(page, "/walk", {"paused": True})
    page.show(Moment(0.0), lambda: True)


def test_a_slowed_walk_takes_its_time(page, walk):
    page.watch(walk)
    news(page, 0)
    ask(page, "/walk", {"speed": 2.0})
    page.show(Moment(0.0), lambda: False)
    begin = time.monotonic()
    page.show(Moment(0.4), lambda: False)
    assert time.monotonic() - begin >= 0.19


def test_a_folder_without_estimates_is_refused_with_a_reason(page, tmp_path):
    with pytest.raises(InputError, match=r"estimates\.mcap"):
        page.follow(RunFolder.create(tmp_path / "old"))
