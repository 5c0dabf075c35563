"""Monitor and inspector: what they believe, and how they show what others say."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from harness import NODES, few, sent_to
from hypothesis import given
from hypothesis import strategies as st
from junk import made_up, spoil, spoiled
from mabirds_msgs.msg import Constraints, EdgeSchedule, FeatureNames, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from truth import Truth, bits

from mabirds_bringup.commands.inspect import _status_line
from mabirds_bringup.draw.node import DrawingNode
from mabirds_bringup.evaluate.results import audit
from mabirds_bringup.watch.described import describe
from mabirds_bringup.watch.edges import edge_states
from mabirds_bringup.watch.inspector import InspectorNode
from mabirds_bringup.watch.live_table import plain_line
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.names import parameter_names
from mabirds_core.texts import sanitize
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.constraints_conversion import constraints_text
from mabirds_msgs_py.feature_names_conversion import feature_names_message


@pytest.fixture
def monitor(truth: Truth, nodes: Any, tmp_path: Path) -> Iterator[MonitorNode]:
    with BagWriter(tmp_path / "recording") as recording:
        yield nodes.add(MonitorNode(truth.experiment, recording, context=nodes.context))


def heard(monitor: MonitorNode) -> dict[str, list[tuple[bytes, bytes]]]:
    return {name: [bits(one) for one in history] for name, history in monitor.history().items()}


def shown(truth: Truth, monitor: MonitorNode) -> None:
    """Whatever a run does with what its monitor heard."""
    monitor.consensus()
    audit(truth.experiment.edge_schedule, monitor.delivered(), truth.experiment.iterations)
    line = plain_line(truth.experiment, monitor)
    assert len(line) < 10_000
    assert line.isprintable()


@NODES
def test_a_monitor_believes_only_what_learners_can_have_said(truth: Truth, monitor: MonitorNode, count: int) -> None:
    numbers = range(1, truth.experiment.iterations + 2)
    true = [(name, truth.parameters(name, n)) for name in truth.experiment.learners for n in numbers]
    for name, message in true:
        sent_to(monitor, f"/{name}/parameters", message)
    expected = heard(monitor)
    assert expected == {name: [bits(one) for one in history] for name, history in truth.history.items()}

    @few(count * 10)
    @given(
        st.one_of(spoiled(lambda: truth.parameters("learner_1", 3)), made_up(ParametersMessage)),
        st.one_of(spoiled(lambda: truth.status("learner_1", iteration=3)), made_up(LearnerStatus)),
        st.one_of(spoiled(truth.schedule), made_up(EdgeSchedule)),
        st.one_of(spoiled(lambda: truth.constraints("learner_1")), made_up(Constraints)),
    )
    def check(
        parameters: ParametersMessage, status: LearnerStatus, schedule: EdgeSchedule, constraints: Constraints
    ) -> None:
        sent_to(monitor, "/learner_1/parameters", parameters)
        sent_to(monitor, "/learner_1/status", status)
        sent_to(monitor, "/learner_1/edge_schedule", schedule)
        sent_to(monitor, "/learner_1/constraints", constraints)
        assert heard(monitor) == expected
        shown(truth, monitor)

    check()


@pytest.mark.parametrize(
    ("lies", "reason", "text"),
    [
        ({"learner": "learner_2"}, "wrong_learner", "status of learner_1: learner 'learner_2', expected 'learner_1'"),
        ({"mixed_from": ["nobody"]}, "impossible_status", "mixed_from ['nobody']: no learner of this experiment"),
        ({"mixed_from": ["x" * 99_999]}, "impossible_status", "... (100003 characters): no learner"),
        ({"iteration": 2**64 - 1}, "impossible_status", "iteration 18446744073709551615: no learner of this"),
        ({"iteration": 0}, "impossible_status", "iteration 0: no learner of this experiment says that"),
        ({"last_demonstration": 7}, "impossible_status", "last_demonstration 7: no learner of this experiment"),
        ({"experiment_digest": "other"}, "wrong_experiment", ""),
        ({"schedule_digest": "other"}, "wrong_schedule", ""),
    ],
)
def test_statuses_that_lie_are_not_shown(
    truth: Truth, monitor: MonitorNode, capfd: pytest.CaptureFixture[str], lies: dict[str, Any], reason: str, text: str
) -> None:
    """What belongs to another run is counted and no word is said about it."""
    for _ in range(3):
        sent_to(monitor, "/learner_1/status", truth.status("learner_1", **lies))
    assert monitor.statuses == {}
    assert monitor.drops == {reason: 3}
    output = "".join(capfd.readouterr())
    assert output.count("dropped status of learner_1: ") == bool(text)
    assert text in output
    shown(truth, monitor)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"theta": [1.0]}, "wrong_shape"),
        ({"omega": [float("nan")] * 26}, "not_finite"),
        ({"omega": [1e200] * 26}, "too_large"),
        ({"iteration": 8}, "future_iteration"),
        ({"iteration": 0}, "old_iteration"),
        ({"omega": [1.0] * 26}, "conflict"),
        ({}, "duplicate"),
    ],
)
def test_parameters_that_do_not_fit_are_not_shown(
    truth: Truth, monitor: MonitorNode, changes: dict[str, Any], reason: str
) -> None:
    """The first of an iteration stays: results are not those of an intruder who came later."""
    sent_to(monitor, "/learner_1/parameters", truth.parameters("learner_1", 1))
    sent_to(monitor, "/learner_1/parameters", spoil(truth.parameters("learner_1", 1), **changes))
    assert monitor.drops == {reason: 1}
    assert heard(monitor)["learner_1"] == [bits(truth.history["learner_1"][0])]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"learner": "learner_2"}, "wrong_learner"),
        ({"experiment_digest": "other"}, "wrong_experiment"),
        ({"names": []}, "wrong_shape"),
        ({"names": ["a wall"], "confidences": [1.0]}, "impossible_constraints"),
    ],
)
def test_constraints_that_lie_are_not_recorded(
    truth: Truth, monitor: MonitorNode, changes: dict[str, Any], reason: str
) -> None:
    sent_to(monitor, "/learner_1/constraints", spoil(truth.constraints("learner_1"), **changes))
    sent_to(monitor, "/learner_1/constraints", truth.constraints("learner_1"))
    assert monitor.drops == {reason: 1}


def test_a_time_before_all_times_is_recorded_as_the_first(truth: Truth, monitor: MonitorNode) -> None:
    message = truth.parameters("learner_1", 1)
    message.stamp.sec = -5
    sent_to(monitor, "/learner_1/parameters", message)
    assert monitor.drops == {}
    assert len(heard(monitor)["learner_1"]) == 1


def test_words_of_others_steer_no_terminal(truth: Truth, monitor: MonitorNode) -> None:
    words = ["\n\x1b[2J", *["x" * 1000] * 1000]
    sent_to(monitor, "/learner_1/status", truth.status("learner_1", waiting_for=words, drop_reasons=words))
    shown(truth, monitor)
    assert "\\n\\x1b[2J, xxx" in plain_line(truth.experiment, monitor)


def test_a_schedule_of_somebody_else_is_not_recorded(truth: Truth, monitor: MonitorNode) -> None:
    sent_to(monitor, "/learner_1/edge_schedule", spoil(truth.schedule(), slots=2))
    sent_to(monitor, "/learner_1/edge_schedule", truth.schedule())
    assert monitor.drops == {"wrong_schedule": 1}


@NODES
def test_an_inspector_shows_messages_of_any_content(truth: Truth, nodes: Any, count: int) -> None:
    """As JSON that every reader takes, and in lines that fit and steer no terminal."""
    inspector = nodes.add(InspectorNode(context=nodes.context))
    inspector.watch("/learner_1")
    learner = inspector.learners["/learner_1"]

    @few(count * 10)
    @given(
        st.one_of(spoiled(lambda: truth.parameters("learner_1", 3)), made_up(ParametersMessage)),
        st.one_of(spoiled(lambda: truth.status("learner_1", iteration=3)), made_up(LearnerStatus)),
        st.one_of(spoiled(truth.schedule), made_up(EdgeSchedule)),
        st.one_of(spoiled(lambda: truth.constraints("learner_1")), made_up(Constraints)),
        made_up(FeatureNames),
    )
    def check(
        parameters: ParametersMessage,
        status: LearnerStatus,
        schedule: EdgeSchedule,
        constraints: Constraints,
        names: FeatureNames,
    ) -> None:
        sent_to(inspector, "/learner_1/parameters", parameters)
        sent_to(inspector, "/learner_1/status", status)
        sent_to(inspector, "/learner_1/edge_schedule", schedule)
        sent_to(inspector, "/learner_1/constraints", constraints)
        sent_to(inspector, "/learner_1/feature_names", names)
        content = describe(learner, top=3)
        edges = learner.edges
        assert edges is None or set(edge_states(edges, {"learner_1": learner.status})) == set(edges.all_edges)
        assert json.dumps(content, allow_nan=False)
        for line in (_status_line(content), constraints_text(learner.constraints or Constraints(), 3)):
            text = sanitize(line, 1000)
            assert len(text) < 20_000
            assert text.isprintable()
        assert set(inspector.missing()) <= {"learner_2"}

    check()


def test_what_cannot_be_shown_is_counted(truth: Truth, nodes: Any) -> None:
    inspector = nodes.add(InspectorNode(context=nodes.context))
    inspector.watch("/learner_1")
    sent_to(inspector, "/learner_1/parameters", spoil(truth.parameters("learner_1", 1), omega=[math.nan]))
    sent_to(inspector, "/learner_1/parameters", spoil(truth.parameters("learner_1", 1), omega=[1e200]))
    sent_to(inspector, "/learner_1/edge_schedule", spoil(truth.schedule(), learners=["intruder", "other"]))
    content = describe(inspector.learners["/learner_1"], top=3)
    assert content["refused"] == {"not_finite": 1, "too_large": 1, "wrong_schedule": 1}
    assert "parameters" not in content
    assert inspector.missing() == []


@pytest.mark.parametrize("names", [["x" * 1000], ["a wall", "a wall"]], ids=["too long", "twice"])
def test_names_that_are_none_are_not_shown(truth: Truth, nodes: Any, names: list[str]) -> None:
    inspector = nodes.add(InspectorNode(context=nodes.context))
    inspector.watch("/learner_1")
    learner = inspector.learners["/learner_1"]
    sent_to(inspector, "/learner_1/parameters", truth.parameters("learner_1", 1))
    sent_to(inspector, "/learner_1/feature_names", FeatureNames(omega=names))
    assert learner.refused == {"impossible_names": 1}
    assert describe(learner, top=1)["parameters"]["costliest"][0]["feature"].startswith("feature ")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"omega": ["a wall"]}, "impossible_names"),
        ({"learner": "learner_2"}, "wrong_learner"),
        ({"experiment_digest": "other"}, "wrong_experiment"),
    ],
)
def test_names_that_lie_are_not_recorded(
    truth: Truth, monitor: MonitorNode, changes: dict[str, Any], reason: str
) -> None:
    names = parameter_names(truth.experiment, "learner_1", build_game(truth.experiment))
    message = feature_names_message(names)
    message.learner, message.experiment_digest = "learner_1", truth.experiment.run_digest("")
    sent_to(monitor, "/learner_1/feature_names", message)
    assert monitor.drops == {}
    sent_to(monitor, "/learner_1/feature_names", spoil(message, **changes))
    assert monitor.drops == {reason: 1}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "game and schedule are the same: it is algorithm"),
        ({"game_digest": "other"}, "different: game"),
        ({"game_digest": "other", "schedule_digest": "other"}, "different: game and schedule"),
    ],
)
def test_what_differs_in_another_experiment_is_named(
    truth: Truth, monitor: MonitorNode, changes: dict[str, str], words: str
) -> None:
    status = truth.status("learner_1", experiment_digest="v4-fixed-other")
    for name, value in changes.items():
        setattr(status, name, value)
    monitor._on_status("learner_1", status)
    assert words in monitor.refusals["wrong_experiment"]


@pytest.mark.parametrize("order", [("parameters", "status"), ("status", "parameters")])
def test_the_consensus_is_drawn_whatever_comes_first(truth: Truth, nodes: Any, order: tuple[str, str]) -> None:
    """Who joins late hears the newest of each, in any order, and nothing after it."""
    drawing = nodes.add(DrawingNode(truth.experiment, rate=20.0, context=nodes.context))
    for name in truth.experiment.learners:
        drawing.watch(f"/{name}")
    say = {"status": lambda name: truth.status(name, iteration=2), "parameters": lambda name: truth.parameters(name, 2)}
    for what in order:
        for name in truth.experiment.learners:
            sent_to(drawing, f"/{name}/{what}", say[what](name))
        nodes.spin_for(0.2)
    published = dict(drawing.get_publisher_names_and_types_by_node("drawing", "/"))
    assert {f"/drawn/consensus/{part}" for part in ("iteration", "theta", "omega")} <= published.keys()
