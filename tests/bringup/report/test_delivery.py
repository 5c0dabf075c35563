"""The graph as it was delivered, and how long it took: what reports draw of what learners said."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from mabirds_msgs.msg import LearnerStatus

from mabirds_bringup.report.delivery_figure import (
    MOST_COLUMNS,
    MOST_EDGES,
    STATES,
    coarser,
    delivery,
    delivery_figure,
)
from mabirds_bringup.report.said import Said, said, timings
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_msgs_py.bag_writer import BagWriter

MILLISECOND = 1_000_000
SCHEDULE = EdgeSchedule(("a", "b", "c"), (frozenset({(0, 1), (1, 0)}), frozenset({(1, 2), (2, 1)})))


def test_each_edge_has_its_state_at_each_iteration() -> None:
    """Whom each of a, b and c mixed in; of iteration 4 nothing was heard."""
    mixed = {1: [["b"], ["a"], []], 2: [[], ["c"], []], 3: [["b"], ["a"], ["b"]]}
    names, states = delivery(SCHEDULE, mixed, {(1, "a", "b"): 0.5, (1, "b", "a"): 0.01}, 4)
    assert names == ["a → b", "b → a", "b → c", "c → b"]
    assert [[STATES[state] for state in row] for row in states] == [
        ["late", "closed", "delivered", "unknown"],
        ["delivered", "closed", "delivered", "unknown"],
        ["closed", "missed", "late", "unknown"],  # what came in a slot in which it was closed is late
        ["closed", "delivered", "closed", "unknown"],
    ]


def test_the_picture_says_what_it_shows_and_its_legend_covers_nothing() -> None:
    names, states = delivery(SCHEDULE, {1: [["b"], ["a"], []], 2: [[], ["c"], []]}, {(1, "a", "b"): 0.5}, 2)
    figure = delivery_figure(names, states)
    figure.canvas.draw()
    (axis,) = figure.axes
    assert axis.get_title() == "3 exchanges of parameters took place, 1 of them late; 1 were missed"
    assert [label.get_text() for label in axis.get_yticklabels()] == names
    legend = axis.get_legend()
    assert legend is not None
    assert [text.get_text().rpartition(": ")[2] for text in legend.get_texts()] == ["2", "1", "1", "4"]
    assert legend.get_window_extent().x0 >= axis.get_window_extent().x1
    assert axis.images[0].get_array().shape == (4, 2)
    plt.close(figure)


def test_of_many_edges_those_with_troubles_are_shown() -> None:
    states = np.full((60, 5), STATES.index("delivered"), dtype=np.int8)
    states[55, 2] = STATES.index("missed")
    figure = delivery_figure([f"edge {k}" for k in range(60)], states)
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert len(labels) == MOST_EDGES
    assert "edge 55" in labels
    assert figure.axes[0].get_ylabel() == f"the {MOST_EDGES} most troubled of 60 edges"
    plt.close(figure)


def test_of_many_iterations_no_miss_is_lost() -> None:
    states = np.zeros((2, 10 * MOST_COLUMNS + 3), dtype=np.int8)
    states[1, 4321] = STATES.index("missed")
    assert coarser(states).shape == (2, MOST_COLUMNS)
    assert (coarser(states) == STATES.index("missed")).sum() == 1
    assert np.array_equal(coarser(states[:, :7]), states[:, :7])


def test_waits_and_times_are_those_of_the_recording(tmp_path: Path) -> None:
    """b waits for its demonstration and for a until 10 ms, for a alone until 40 ms."""
    told = [
        (0, 3, ["demonstration", "a"], 0.002),
        (10, 3, ["a"], 0.002),
        (40, 4, [], 0.005),
    ]
    with BagWriter(tmp_path / "bag") as bag:
        for time, iteration, waiting, seconds in told:
            metrics = {"metric_names": ["iteration_seconds"], "metric_values": [seconds]}
            status = LearnerStatus(learner="b", iteration=iteration, waiting_for=waiting, **metrics)
            bag.write("/b/status", status, time * MILLISECOND)
    found = said(tmp_path, ("a", "b"))
    assert found.waits == {(3, "a", "b"): pytest.approx(0.03)}
    assert found.seconds == {"b": {2: 0.002, 3: 0.005}}
    assert timings(found) == [["b", "2", "3.5", "4.85", "5", "30"]]


def test_a_run_without_a_recording_or_with_a_damaged_one_tells_nothing(tmp_path: Path) -> None:
    assert said(tmp_path, ("a",)) == Said({}, {})
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"nonsense")
    assert said(tmp_path, ("a",)) == Said({}, {})
