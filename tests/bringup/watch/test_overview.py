"""What `mabirds inspect` shows in a terminal, without a network."""

import os
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from mabirds_msgs.msg import LearnerStatus, Parameters, PlayerStatus
from rich.console import Console
from std_msgs.msg import Header

from mabirds_bringup.draw.messages import grid
from mabirds_bringup.watch.cost_map import MOST_COLUMNS, MOST_ROWS, cost_map
from mabirds_bringup.watch.inspector import WatchedLearner
from mabirds_bringup.watch.overview import overview
from mabirds_bringup.watch.recent import RecentParameters
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.games.scene import Raster
from mabirds_msgs_py.conversion import schedule_message

SCHEDULE = EdgeSchedule(("learner_1", "learner_2"), (frozenset({(0, 1), (1, 0)}), frozenset()))


def learner(name: str, **fields: Any) -> WatchedLearner:
    watched = WatchedLearner(f"/{name}", schedule=schedule_message(SCHEDULE))
    for moment in (0.0, 1.0):
        watched.status = LearnerStatus(learner=name, iteration=8 + int(2 * moment), last_demonstration=9, **fields)
        watched.note_status(moment)
    theta = [3.0, 4.0] if name == "learner_1" else [3.0, 3.0]
    watched.parameters = Parameters(learner=name, iteration=10, theta=theta, omega=[1.0])
    return watched


@pytest.fixture
def node() -> Any:
    learners = (learner("learner_1", waiting_for=["learner_2"]), learner("learner_2", message="learner_1 is back"))
    player = PlayerStatus(
        playing=True,
        paused=True,
        rate=10.0,
        last=Time(sec=40),
        at=Time(sec=10),
        learners=["learner_1", "learner_2"],
        sent=[9, 10],
        total=[40, 40],
    )
    by_namespace = {watched.namespace: watched for watched in learners}
    return SimpleNamespace(learners=by_namespace, players={"/expert_player/player_status": player})


def lines(node: Any, maps: dict[str, Any] | None = None) -> list[str]:
    recent = RecentParameters()
    for watched in node.learners.values():
        recent.note(watched.namespace, watched.parameters)
    console = Console(width=60, record=True, file=open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123
    console.print(overview(node, recent, maps or {}))
    console.file.close()
    return console.export_text().splitlines()


def test_the_view_tells_of_player_learners_edges_and_distances(node: Any) -> None:
    shown = lines(node)
    text = " ".join(" ".join(shown).split())
    assert max(map(len, shown)) <= 60
    assert "player expert_player: paused 10x, 19/80 sent, 3s left" in text
    row = next(line for line in shown if line.startswith("learner_1 "))
    assert row.split()[1:7] == [
        "no",
        "demo",
        "9/40",
        "2",
        "16s",
        "0",
    ]
    assert "learner_1 waits for learner_2 (iteration 10)" in text
    assert "learner_2: learner_1 is back" in text
    assert "learner_2→learner_1 late" not in text  # slot 2 of iteration 10 has no edge: what is waited for is a lie
    assert "apart at iteration 10: theta 0.5 (10% of its norm), omega 0 (0% of its norm)" in text


def test_edges_of_the_present_slot_are_told(node: Any) -> None:
    node.learners["/learner_1"].status.iteration = 11
    text = " ".join(" ".join(lines(node)).split())
    assert "learner_2→learner_1 late" in text
    assert "learner_1→learner_2 missed" in text


def test_costs_are_a_small_map(node: Any) -> None:
    values = np.array([[0.0, 1.0, 0.0], [0.5, 0.2, 0.0]])  # row 0 is at the bottom
    small = grid(Header(), Raster(2, 3, 1.0), values)
    assert cost_map(small) == "▒░·\n·█·"
    shown = lines(node, {"/learner_1/drawn/costs/expert_1": small})
    at = next(number for number, line in enumerate(shown) if "learner_1 expert_1" in line)
    assert [line.strip() for line in shown[at + 1 : at + 3]] == ["▒░·", "·█·"]


def test_a_large_map_keeps_its_costliest_places() -> None:
    values = np.zeros((60, 90))
    values[59, 0] = 1.0
    text = cost_map(grid(Header(), Raster(60, 90, 0.1), values)).splitlines()
    assert (len(text), len(text[0])) == (MOST_ROWS, MOST_COLUMNS)
    assert text[0][0] == "█"
    assert "".join(text).count("·") == MOST_ROWS * MOST_COLUMNS - 1
