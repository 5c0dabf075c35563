"""What is shown while a network runs, without a network."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from mabirds_msgs.msg import LearnerStatus, PlayerStatus
from rich.console import Console

from mabirds_bringup.commands import run as run_command
from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.console import guarded_output, judges_table, print_json, summary_table
from mabirds_bringup.evaluate.evaluation import evaluate
from mabirds_bringup.report.page import write_report
from mabirds_bringup.run import processes
from mabirds_bringup.watch.live_table import Pace, live_table, plain_line
from mabirds_core.experiment.file import Experiment, load_experiment


@pytest.fixture
def monitor() -> Any:
    """A monitor that has heard learner_1 only."""
    status = LearnerStatus(
        learner="learner_1",
        state=LearnerStatus.WAITING_FOR_NEIGHBOURS,
        iteration=5,
        last_demonstration=4,
        backlog=2,
        waiting_for=["learner_2"],
        metric_names=["iteration_seconds"],
        metric_values=[0.0125],
        drop_reasons=["not_finite"],
        drop_counts=[3],
    )
    names = ("learner_1", "learner_2")
    presence = SimpleNamespace(is_lost=lambda name: name in gone)
    gone: set[str] = set()
    return SimpleNamespace(
        names=names,
        statuses={"learner_1": status},
        consensus=lambda: (5, 0.25, 1.5),
        presence=presence,
        gone=gone,
        player=None,
    )


def test_the_live_table_says_who_waits_for_whom(experiment: Experiment, monitor: Any) -> None:
    console = Console(width=100, record=True, file=open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123
    console.print(live_table(experiment, monitor, Pace()))
    console.file.close()
    text = console.export_text()
    for cell in (
        "4/6",
        "waiting",
        "learner_2 (iteration 5)",
        "0.013",
        "not_finite 3",
        "starting",
        "theta 0.25, omega 1.5",
    ):
        assert cell in text, text


def shown(renderable: Any, width: int = 60) -> list[str]:
    console = Console(width=width, record=True, file=open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123
    console.print(renderable)
    console.file.close()
    return console.export_text().splitlines()


PLAYING = PlayerStatus(
    playing=True, rate=2.0, last=Time(sec=100), at=Time(sec=40), learners=["learner_1"], sent=[4], total=[6]
)


def test_the_live_table_fits_60_columns_and_keeps_their_widths(experiment: Experiment, monitor: Any) -> None:
    """Whatever happens, a column begins where it began; nothing is shortened that matters."""
    monitor.player = PLAYING
    clock = iter([0.0, 10.0])
    pace = Pace(lambda: next(clock))
    before = shown(live_table(experiment, monitor, Pace(lambda: 0.0)))
    monitor.statuses["learner_1"].last_demonstration = 1
    pace.note(monitor)
    monitor.statuses["learner_1"].last_demonstration = 5
    monitor.statuses["learner_1"].metric_values = [123.4567]
    pace.note(monitor)
    after = shown(live_table(experiment, monitor, pace))
    for lines in (before, after):
        assert max(map(len, lines)) <= 60
        assert "player playing 2x, 4/6 sent, 30s left" in " ".join(lines)
    headers = [next(line for line in lines if "ETA" in line) for lines in (before, after)]
    assert headers[0] == headers[1]
    row = next(line for line in after if "5/6" in line)
    assert row.split()[:5] == ["learner_1", "5/6", "waiting", "2s", "2"]
    assert "123.4" in row  # seconds of six letters, cut short rather than moved


def test_the_slowest_learner_says_how_long_all_take() -> None:
    seconds, learned = iter([0.0, 0.0, 10.0, 10.0]), {"quick": 1, "slow": 1}

    def statuses() -> Any:
        return SimpleNamespace(statuses={name: SimpleNamespace(last_demonstration=n) for name, n in learned.items()})

    pace = Pace(lambda: next(seconds))
    assert pace.slowest(41) == ""
    pace.note(statuses())
    assert pace.slowest(41) == ""
    learned |= {"quick": 21, "slow": 11}
    pace.note(statuses())
    assert pace.slowest(41) == "30s"


def test_nothing_is_printed_twice_where_there_is_no_terminal(
    experiment: Experiment, monitor: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    printed: list[str] = []
    monkeypatch.setattr(run_command, "LINE_PERIOD", 0.0)
    monkeypatch.setattr(run_command.console, "print", lambda line, **_: printed.append(line))
    display = run_command._Display(experiment, SimpleNamespace(only=(), names=("learner_1", "learner_2")))
    for _ in range(3):
        display.update(monitor, None, [])
    monitor.statuses["learner_1"].last_demonstration = 5
    display.update(monitor, None, [])
    assert len(printed) == len(set(printed)) == 2


def test_a_learner_whose_process_is_gone_is_shown_as_gone(experiment: Experiment, monitor: Any) -> None:
    assert "learner_1 4/6 waiting learner_2 (iteration 5)" in plain_line(experiment, monitor)
    monitor.gone.add("learner_1")
    assert "learner_1 4/6 gone learner_2 (iteration 5)" in plain_line(experiment, monitor)


def test_a_status_of_a_newer_version_is_shown_too(experiment: Experiment, monitor: Any) -> None:
    monitor.statuses["learner_1"].state = 99
    monitor.statuses["learner_1"].waiting_for = []
    assert "state 99?" in plain_line(experiment, monitor)


NATS = {"held_out_log_likelihood": 1.5, "fixed_log_likelihood": None}
VERDICT = {"violation_rate": 0.125, "success_rate": 0.875, "value": 12.5, "certificate": None, **NATS}


def test_verdicts_are_a_table_of_their_own() -> None:
    rows = {"ann": {"judges": {"fine lattice": VERDICT}}, "bob": {"judges": {"fine lattice": VERDICT}}}
    table = judges_table({"learners": rows})
    assert table is not None
    assert [list(column.cells) for column in table.columns] == [
        *(["ann", "bob"], ["fine lattice"] * 2, ["0.1250"] * 2, ["0.8750"] * 2, ["12.50"] * 2, [""] * 2)
    ]
    assert judges_table({"learners": {"ann": {"judges": {}}}}) is None


def test_summaries_fit_60_columns_with_all_their_digits() -> None:
    """Of long runs with long names, too."""
    row = {
        "iterations": 2000,
        "held_out_log_likelihood": -388.12,
        "learned_constraints": dict.fromkeys("abc"),
        "false_discovery_rate": 0.125,
        "undetermined": 136,
        "judges": {"hexagonal lattice at 0.125 m": VERDICT},
        **dict.fromkeys(("violation_rate", "success_rate", "success_late_minimum"), 0.0625),
    }
    rule = {"experiment": "patrol", "constraint_rule": "counterfactual test", "expert_log_likelihood": -6.2}
    summary = {**rule, "learners": {"learner_1": row, "learner_of_a_long_name": row}}
    console = Console(width=60, record=True, file=open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123
    console.print(summary_table(summary))
    console.print(judges_table(summary))
    console.file.close()
    text = console.export_text()
    assert max(map(len, text.splitlines())) <= 60
    assert "…" not in text
    digits = ["2000", "0.0625", "0.0625", "0.0625", "-388.12", "3", "0.125", "136"]
    assert text.count(" ".join(digits).replace(" 3 ", "     3 ").replace("0.125 136", "0.125  136")) == 2
    assert text.count("0.1250 0.8750 12.50") == 2


def test_the_report_shows_its_numbers(tmp_path: Path) -> None:
    rates = {"violation_rate": 0.002, "success_rate": 0.998, "success_late_minimum": 0.91}
    errors = {"false_discovery_rate": 0.1, "false_positive_rate": 0.237, "false_negative_rate": 0.0, "auc": None}
    row = {
        "iterations": 40,
        **rates,
        **errors,
        "held_out_log_likelihood": -6.43,
        "occupancy_distance": 0.05,
        "learned_constraints": {"a wall": 0.987},
        "undetermined": 4,
        "judges": {"fine lattice": VERDICT},
    }
    summary = {
        "experiment": "<patrol>",
        "constraint_rule": "counterfactual test at confidence 0.95",
        "expert_log_likelihood": -6.23,
        "fixed_log_likelihoods": {"uniform": 0.0, "straight flight": 8.5},
        "rates": "shares of 1000 rollouts",
        "learners": {"learner_1": row},
        "consensus_distance": {"theta": 3.85, "omega": 6.95, "policy": 0.87},
        "wall_seconds": 12.0,
        "complete": True,
        "missing": [],
    }
    (tmp_path / "map.png").write_bytes(b"a picture")
    write_report(tmp_path, summary, {"map.png": "a map"})
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "![a map](map.png)" in (tmp_path / "report.md").read_text(encoding="utf-8")
    for text in (
        "&lt;patrol&gt;",
        "<td>40</td>",
        "<td>0.002</td>",
        "<td>0.998</td>",
        "<td>-6.43</td>",
        "-6.23",
        "<td>a wall</td><td>0.987</td>",
        "and 4 undetermined",
        "confidence 0.95",
        "of 1000 rollouts",
        "data:image/png;base64,YSBwaWN0dXJl",
        "reach their goals and keep every true constraint in 99.8 % of trials",
        "That was not always so: within the last 15 judged iterations success fell to 91.0 %.",
        "0.00 (uniform), 8.50 (straight flight)",
        "<td>fine lattice</td><td>0.125</td>",
        "<td>0.875</td><td>12.50</td>",
    ):
        assert text in page


def test_what_libraries_print_does_not_spoil_json(capfd: pytest.CaptureFixture[str]) -> None:
    with guarded_output() as stdout:
        os.write(1, b"an error of the middleware\n")
        print_json({"a": 1}, stdout)
    output, errors = capfd.readouterr()
    assert output == '{"a": 1}\n'
    assert "an error of the middleware" in errors


def test_a_node_that_ignores_sigterm_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "STOP_PATIENCE", 0.2)
    script = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf'); signal.pause()"
    child = processes.start("deaf", [sys.executable, "-c", script], tmp_path)
    while "deaf" not in child.log.read_text(encoding="utf-8"):
        assert child.exit_code is None
    processes.stop([child])
    assert child.exit_code == -9


def test_the_time_series_of_consensus_has_one_value_an_iteration(make_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(make_experiment(iterations=4))
    evaluation = evaluate(experiment, simulate_from_bag(experiment), demonstrations_of(experiment))
    assert len(evaluation.consensus_theta) == len(evaluation.consensus_omega) == 5
    assert evaluation.consensus_theta[0] == 0.0
    assert np.isfinite(evaluation.consensus_omega).all()
