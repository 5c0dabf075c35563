"""The schedule among some of its learners: who they are, which edges stay, and when they cannot learn together."""

import networkx as nx
import numpy as np
import pytest
from graphs import network, schedules
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.consensus.membership import restrict
from mabirds_core.consensus.schedule import EdgeSchedule, both_ways
from mabirds_core.errors import ScheduleError

NAMES = ("ann", "bob", "cid", "dee")
LINE = both_ways([(0, 1), (1, 2), (2, 3)])
SCHEDULE = EdgeSchedule(NAMES, (LINE, both_ways([(1, 3)])), end="hold")


def test_all_of_them_have_the_schedule_they_had() -> None:
    whole = EdgeSchedule(NAMES, (LINE, LINE | both_ways([(1, 3)])), end="hold")
    assert restrict(whole, reversed(NAMES)) == whole


def test_members_keep_their_order_and_the_edges_among_them() -> None:
    schedule = EdgeSchedule(NAMES, (both_ways([(1, 3), (0, 3)]), LINE, both_ways([(0, 2)])))
    remaining = restrict(schedule, ["dee", "bob", "cid"])
    assert remaining.learners == ("bob", "cid", "dee")
    assert remaining.slots == (both_ways([(0, 2)]), both_ways([(0, 1), (1, 2)]), frozenset())


def test_directions_stay() -> None:
    ring = EdgeSchedule(("a", "b", "c"), (frozenset({(0, 1), (1, 2), (2, 0), (2, 1)}),), end="stop")
    both = EdgeSchedule(("a", "b", "c"), (frozenset({(0, 1)}), frozenset({(1, 0), (0, 2), (2, 0)})))
    assert restrict(ring, "bc") == EdgeSchedule(("b", "c"), (both_ways([(0, 1)]),), end="stop")
    assert restrict(both, "ca") == EdgeSchedule(("a", "c"), (frozenset(), both_ways([(0, 1)])))


def test_one_is_enough() -> None:
    assert restrict(SCHEDULE, ["cid"]) == EdgeSchedule(("cid",), (frozenset(), frozenset()), end="hold")


def test_members_may_be_named_twice() -> None:
    assert restrict(EdgeSchedule(NAMES, (LINE,)), ["bob", "cid", "bob"]).learners == ("bob", "cid")


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ([], r"members \[\]: expected some of the learners \['ann', 'bob', 'cid', 'dee'\]"),
        (list("hbfdgace"), r"members \['a', 'b', 'c', 'd', 'e', 'f', 'g', 'h'\]: expected some"),
        ([*NAMES, "zoe"], "expected some of the learners"),
        (["ann", "cid"], r"nothing that ann knows ever reaches cid: .*Assumption 2"),
    ],
)
def test_who_cannot_learn_together_is_refused(members: list[str], words: str) -> None:
    with pytest.raises(ScheduleError, match=words):
        restrict(EdgeSchedule(NAMES, (LINE,)), members)


def test_a_departure_that_leaves_an_edge_on_no_cycle_is_refused() -> None:
    """ann, bob and cid send around; without cid nothing comes back from bob to ann in that slot."""
    schedule = EdgeSchedule(NAMES[:3], (frozenset({(0, 1), (1, 2), (2, 0)}), both_ways([(0, 1)])))
    with pytest.raises(ScheduleError, match="edge ann -> bob lies on no directed cycle"):
        restrict(schedule, ["ann", "bob"])


@given(schedules(), st.sets(st.integers(0, 4), min_size=1))
def test_what_remains_is_the_induced_graph_of_every_slot(schedule: EdgeSchedule, chosen: set[int]) -> None:
    kept = sorted(v for v in chosen if v < len(schedule.learners)) or [0]
    try:
        remaining = restrict(schedule, [schedule.learners[v] for v in kept])
    except ScheduleError:
        return
    for found, slot in zip(remaining.slots, schedule.slots, strict=True):
        induced = network((len(schedule.learners), slot)).subgraph(kept)
        renamed = nx.relabel_nodes(induced, {v: number for number, v in enumerate(kept)})
        assert found == frozenset(renamed.edges)
    np.testing.assert_allclose(remaining.weights(1).sum(axis=0), 1.0)
