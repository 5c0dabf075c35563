"""The audit of the delivered graph."""

from mabirds_bringup.evaluate.results import audit
from mabirds_core.consensus.schedule import EdgeSchedule, both_ways

SCHEDULE = EdgeSchedule(("a", "b", "c"), (both_ways([(0, 1)]), both_ways([(1, 2)])))
FIRST, SECOND = [["b"], ["a"], []], [[], ["c"], ["b"]]


def test_a_run_as_scheduled_has_the_schedules_window() -> None:
    delivered = {1: FIRST, 2: SECOND, 3: FIRST, 4: SECOND}
    assert audit(SCHEDULE, delivered, 4) == {"iterations": 4, "edge_mismatches": [], "connectivity_window": 2}


def test_a_graph_that_connects_nobody_has_no_window() -> None:
    found = audit(SCHEDULE, {1: FIRST, 2: [[], [], []]}, 2)
    assert found["connectivity_window"] is None
    assert found["edge_mismatches"] == ["iteration 2: b -> c not delivered", "iteration 2: c -> b not delivered"]


def test_iterations_that_were_not_heard_of_leave_the_window_open() -> None:
    assert audit(SCHEDULE, {2: SECOND}, 2) == {"iterations": 1, "edge_mismatches": [], "connectivity_window": None}
    assert audit(SCHEDULE, {}, 2) == {"iterations": 0, "edge_mismatches": [], "connectivity_window": None}
