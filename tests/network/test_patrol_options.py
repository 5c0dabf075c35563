"""Patrols with every option over the network: bags of demonstrations of different lengths, and the reference's bits."""

import csv
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from identity import assert_same_histories
from rclpy.context import Context

from mabirds_bringup.commands.report import check, report
from mabirds_bringup.commands.simulate import simulate, simulate_from_bag
from mabirds_bringup.run.run_directory import read_judged
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_expert_player.recorder import expert_streams
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.conversion import demonstration_message, floats
from mabirds_msgs_py.topics import bag_topic

HALL: dict[str, Any] = {
    "map": "....\n....\n....",
    "starts": [[[1, 0], [2, 1]], [[0, 0], [2, 2]]],
    "goals": [[[0, 3], [1, 3], [2, 3]], [[0, 0], [0, 1], [0, 3]]],
    "leaving": True,
    "waiting": True,
    "diagonals": True,
    "horizon": 9,
}
GAMES: dict[str, dict[str, Any]] = {
    "as chosen": HALL,
    "slipping": HALL | {"slip": 0.1},
    "unknown truth": HALL | {"slip": 0.1, "truth": "unknown"},
}
EXPECTATIONS = {"as chosen": "exact", "slipping": "sampled", "unknown truth": "exact"}
OF_TRUTH = (
    "violation_rate",
    "success_rate",
    "success_late_mean",
    "success_late_minimum",
    "success_first_iteration",
    "success_stays_from_iteration",
    "false_positive_rate",
    "false_negative_rate",
    "false_discovery_rate",
    "auc",
)
every_game = pytest.mark.parametrize("name", GAMES)


def written(make_experiment: Callable[..., Path], name: str) -> Path:
    """An experiment whose demonstrations end when all have left, each with as many steps as it took."""
    shown = {"bag": "bag", "per_learner": 6, "experts": "soft"}
    change = {"game": GAMES[name] | {"truth": "map"}, "closing_rounds": 1, "demonstrations": shown}
    file = make_experiment(iterations=6, change=change)
    known = load_experiment(file)
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    algorithm = {"expectation": EXPECTATIONS[name], "rollouts": 20}
    file.write_text(yaml.safe_dump({**content, "game": GAMES[name], "algorithm": algorithm}), encoding="utf-8")
    shutil.rmtree(known.demonstrations.bag)
    record_what_it_took(known, load_experiment(file))
    return file


def record_what_it_took(known: Experiment, experiment: Experiment) -> None:
    """Experts of the ``known`` truth demonstrate in the game of ``experiment``, until the last has left."""
    game, lengths = build_game(experiment), set[int]()
    with BagWriter(experiment.demonstrations.bag) as bag:
        for learner, stream in expert_streams(known, build_game(known)).items():
            for iteration, shown in enumerate(stream, start=1):
                message = demonstration_message(game, learner, iteration, shown, iteration)
                states, actions = game.encode(shown)
                arrived = np.flatnonzero(game.goal[shown.states[0]])  # type: ignore[attr-defined]
                rows = int(arrived[0]) + 1 if len(arrived) else len(states)
                message.steps, message.states, message.actions = rows, floats(states[:rows]), floats(actions[:rows])
                bag.write(bag_topic(learner), message, iteration)
                lengths.add(message.steps)
    assert len(lengths) > 1


@every_game
def test_nodes_equal_the_reference(
    make_experiment: Callable[..., Path], nodes: Any, context: Context, tmp_path: Path, name: str
) -> None:
    file = written(make_experiment, name)
    experiment = load_experiment(file)
    with BagWriter(tmp_path / "recording") as recording:
        monitor = nodes.add(MonitorNode(experiment, recording, context=context))
        for learner in experiment.learners:
            nodes.learner(file, learner)
        nodes.player(file, hz=50.0)
        nodes.spin_until(lambda: monitor.finished)
    assert not monitor.drops
    assert_same_histories(monitor.history(), simulate_from_bag(experiment))


def test_a_run_without_truth_is_judged_by_what_can_be_known(
    make_experiment: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(make_experiment, "unknown truth")
    simulate(file, out=tmp_path / "runs")
    directory = (tmp_path / "runs" / "latest").resolve()
    table, page = capsys.readouterr().err, (directory / "report.html").read_text(encoding="utf-8")
    content = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    assert content["complete"]
    assert len(content["learners"]) == 2
    for row in content["learners"].values():
        assert {row[name] for name in OF_TRUTH} == {None}
        assert row["undetermined"] > 0
        assert row["iterations"] == 6
    assert "found" in table
    for heading in ("CVR", "SR", "FDR", "FPR", "AUC"):
        assert heading not in table
        assert f"<th>{heading}</th>" not in page
    assert "Nobody knows the true constraints" in page
    words = (directory / "report.md").read_text(encoding="utf-8")  # without the letters of embedded pictures
    assert not re.search(r"\bnan\b", words)
    rows = list(csv.DictReader((directory / "metrics.csv").read_text(encoding="utf-8").splitlines()))
    assert {row["success_rate"] for row in rows} == {row["violation_rate"] for row in rows} == {""}
    assert all(row["consensus_theta"] for row in rows)
    before = [row.success_rate for row in read_judged(directory)]
    assert before == [None] * len(rows)
    assert (directory / "map.png").stat().st_size > 1000
    assert report([directory]) == 0
    assert check(directory) == 0


def test_demonstrations_of_an_unknown_truth_can_only_be_recordings(make_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(written(make_experiment, "unknown truth"))
    with pytest.raises(ExperimentError, match="has no experts; bring a bag of recordings instead"):
        expert_streams(experiment, build_game(experiment))
