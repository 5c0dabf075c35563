"""The live page in a browser: its numbers are those published, its controls act, it loads nothing from elsewhere."""

import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mabirds_bringup.dashboard.board import LearnerView, Snapshot
from mabirds_bringup.dashboard.drawings import cost_map, graph
from mabirds_bringup.dashboard.page import learner_table
from mabirds_bringup.run.processes import learner_command, player_command, start, stop
from mabirds_bringup.watch.inspector import InspectorNode
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.games.scene import scene_of

CHROMIUM = os.environ.get("MABIRDS_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
BROWSER = pytest.mark.skipif(
    CHROMIUM is None,
    reason="the live page in a browser: no Chromium here (apt-get install chromium, or MABIRDS_CHROMIUM=/its/place)",
)
KEY = "the-key"
ITERATIONS = 480  # two minutes at 4 Hz: the network still plays when a slow machine has opened its browser
PHONE, DESKTOP = {"width": 390, "height": 844}, {"width": 1280, "height": 900}


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def address(
    shared_ros_domain: int, make_shared_experiment: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[str]:
    """A network that plays slowly, and its page."""
    file, logs, port = make_shared_experiment(iterations=ITERATIONS), tmp_path_factory.mktemp("logs"), free_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(shared_ros_domain))
        patch.delenv("PYTEST_CURRENT_TEST", raising=False)  # by which nicegui would take itself for a part of the test
        page = [sys.executable, "-m", "mabirds_bringup", "dashboard", str(file), "--port", str(port), "--key", KEY]
        nodes = [start(name, learner_command(name, file), logs) for name in ("learner_1", "learner_2")]
        nodes += [start("player", player_command(file, {"hz": 4.0}), logs), start("page", page, logs)]
        try:
            deadline = time.monotonic() + 60
            while not _serves(port):
                assert time.monotonic() < deadline, nodes[-1].log.read_text()
                assert nodes[-1].exit_code is None, nodes[-1].log.read_text()
                time.sleep(0.2)
            yield f"http://127.0.0.1:{port}/"
        finally:
            stop(nodes)


def _serves(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), timeout=1).close()
    except OSError:
        return False
    return True


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


class Visit:
    """A page with all that it fetched, and all that its console said."""

    def __init__(self, browser: Any, address: str, viewport: dict[str, int]) -> None:
        self.page = browser.new_page(viewport=viewport)
        self.fetched, self.errors = list[str](), list[str]()
        self.page.on("request", lambda request: self.fetched.append(request.url))
        self.page.on("console", lambda said: self.errors.append(said.text) if said.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(address)
        self.page.wait_for_selector("[data-testid=map-learner_2-2] svg", timeout=20_000)

    def text(self, name: str) -> str:
        return str(self.page.locator(f"[data-testid={name}]").inner_text())

    def wait_for_text(self, name: str, pattern: str) -> str:
        from playwright.sync_api import expect

        expect(self.page.locator(f"[data-testid={name}]")).to_have_text(re.compile(pattern), timeout=15_000)
        return self.text(name)


@BROWSER
def test_numbers_are_those_published_and_controls_act(
    address: str, browser: Any, nodes: Any, shared_ros_domain: int, tmp_path: Path
) -> None:
    visit = Visit(browser, f"{address}?key={KEY}", DESKTOP)
    visit.wait_for_text("player", "playing")
    visit.page.locator("[data-testid=pause]").click()
    visit.wait_for_text("player", "paused")
    visit.wait_for_text("pause", "[Rr]esume|RESUME")
    status = settled(shared_ros_domain)
    if status["learner_1"].last_demonstration != status["learner_2"].last_demonstration:  # paused between the two
        visit.page.locator("[data-testid=next]").click()
        most = max(learner.last_demonstration for learner in status.values())
        for name in status:
            visit.wait_for_text(f"{name}-learned", rf"^{most}/{ITERATIONS}$")
        status = settled(shared_ros_domain)
    for name in ("learner_1", "learner_2"):
        visit.wait_for_text(f"{name}-learned", rf"^{status[name].last_demonstration}/{ITERATIONS}$")
        assert visit.text(f"{name}-backlog") == str(status[name].backlog)
        assert visit.text(f"{name}-state") == "waits for a demonstration"
    learned = status["learner_1"].last_demonstration
    visit.page.locator("[data-testid=next]").click()
    visit.page.locator("[data-testid=next]").click()
    visit.wait_for_text("learner_1-learned", rf"^{learned + 1}/{ITERATIONS}$")
    visit.wait_for_text("consensus", rf"apart at iteration {learned + 2}: theta .*% of its norm")
    assert visit.page.locator("[data-testid=graph] line.edge").count() == 2
    visit.page.locator("[data-testid=pause]").click()
    visit.wait_for_text("player", "playing")
    visit.page.screenshot(path=tmp_path / "desktop.png", full_page=True)
    assert visit.errors == []
    assert [url for url in visit.fetched if not url.startswith((address, "ws://127.0.0.1", "data:"))] == []
    assert len(visit.fetched) > 5


def settled(domain: int) -> dict[str, Any]:
    """What learners say, once they have learned all that a paused player sent."""
    deadline = time.monotonic() + 30
    while True:
        assert time.monotonic() < deadline, "demonstrations are still under way"
        inspector = ask_network(domain)
        status = {learner.name: learner.status for learner in inspector.learners.values()}
        players = [heard for heard in inspector.players.values() if heard is not None]
        sent = {name: count for player in players for name, count in zip(player.learners, player.sent, strict=True)}
        if sent == {name: learner.last_demonstration for name, learner in status.items()}:
            return status


def ask_network(domain: int) -> InspectorNode:
    """The newest that learners say, heard by somebody else."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor

    own = Context()
    rclpy.init(args=[], context=own, domain_id=domain)
    inspector, executor = InspectorNode(context=own), SingleThreadedExecutor(context=own)
    executor.add_node(inspector)
    deadline = time.monotonic() + 20
    while not inspector.complete:
        assert time.monotonic() < deadline
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    inspector.destroy_node()
    rclpy.try_shutdown(context=own)
    return inspector


@BROWSER
@pytest.mark.parametrize("viewport", [PHONE, DESKTOP], ids=["phone", "desktop"])
def test_strangers_look_and_nothing_is_cut_off(
    address: str, browser: Any, viewport: dict[str, int], tmp_path: Path
) -> None:
    visit = Visit(browser, f"{address}?key=wrong", viewport)
    assert "read only" in visit.page.content()
    for control in ("pause", "next", "rate", "set-rate"):
        assert visit.page.locator(f"[data-testid={control}]").count() == 0
    wide, shown = visit.page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert wide <= shown
    for name in ("map-learner_1-1", "graph", "curve-backlog"):
        box = visit.page.locator(f"[data-testid={name}]").bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= shown
        assert min(box["width"], box["height"]) > 100
    visit.page.screenshot(path=tmp_path / "page.png", full_page=True)
    assert visit.errors == []


def test_a_page_on_a_machine_without_the_library_says_what_to_install(tmp_path: Path) -> None:
    program = "import sys; sys.modules['nicegui'] = None; from mabirds_bringup.cli import main; main()"
    file = Path(__file__).resolve().parents[2] / "ros_ws" / "config" / "patrol.yaml"
    command = [sys.executable, "-c", program, "dashboard", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "install mabirds_bringup[dashboard]" in " ".join(done.stderr.split())


def test_words_of_others_are_text_on_the_page() -> None:
    content = {
        "state": "<script>alert(1)</script>",
        "last_demonstration": 1,
        "iterations_per_second": None,
        "backlog": 0,
        "dropped": {},
    }
    text = learner_table(Snapshot((LearnerView('"><b>x', content, None, None),)), 5)
    assert "<script>" not in text
    assert "<b>" not in text
    assert "<b>" not in graph(("<b>ann", "bob"), {(0, 1): "late"})


def test_a_map_is_black_where_places_cost_most() -> None:
    file = Path(__file__).resolve().parents[2] / "ros_ws" / "config" / "patrol.yaml"
    scene = scene_of(build_game(load_experiment(file)))
    assert scene is not None
    costs = np.zeros((7, 7))
    empty, full = cost_map(scene, costs, 0.0, 0, None), cost_map(scene, costs + np.eye(7), 1.0, 0, None)
    assert empty.count("<image") == full.count("<image") == 2
    assert empty != full
