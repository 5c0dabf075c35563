"""Edge schedules: Assumption 2 against networkx by brute force, Assumption 3, neighbours and digests."""

from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
from graphs import Graph, digraphs, network, schedules
from hypothesis import assume, given
from hypothesis import strategies as st

from mabirds_core.consensus import schedule as schedule_module
from mabirds_core.consensus.assumptions import connectivity_window, unreachable, validate
from mabirds_core.consensus.generators import alternating_ring, complete_edges, ring_edges, static
from mabirds_core.consensus.schedule import EdgeSchedule, both_ways, delivered_edges, require_size
from mabirds_core.consensus.weights import Edge
from mabirds_core.digest import digest
from mabirds_core.errors import ScheduleError

NAMES = ("a", "b", "c")
TALKING = EdgeSchedule(NAMES, (frozenset({(0, 1), (2, 1), (1, 0)}), frozenset(), frozenset({(1, 2), (0, 2)})))


def learners(count: int) -> tuple[str, ...]:
    return tuple(f"learner_{v + 1}" for v in range(count))


def every_window_is_connected(schedule: EdgeSchedule, window: int) -> bool:
    """Is the union of E(n), ..., E(n + window - 1) strongly connected for every n of a few periods?"""
    unions = (
        frozenset().union(*(schedule.edges(n + k) for k in range(window)))
        for n in range(1, 2 * len(schedule.slots) + 1)
    )
    return all(nx.is_strongly_connected(network((len(schedule.learners), union))) for union in unions)


@given(digraphs())
def test_unreachable_finds_a_pair_without_a_way_if_and_only_if_there_is_one(graph: Graph) -> None:
    found, built = unreachable(*graph), network(graph)
    if found is None:
        assert nx.is_strongly_connected(built)
    else:
        assert not nx.has_path(built, *found)


@given(schedules())
def test_the_smallest_window_is_that_of_brute_force(schedule: EdgeSchedule) -> None:
    candidates = range(1, 2 * len(schedule.slots) + 1)
    fitting = [window for window in candidates if every_window_is_connected(schedule, window)]
    if fitting:
        assert connectivity_window(schedule) == fitting[0]
    else:
        with pytest.raises(ScheduleError, match="Assumption 2"):
            connectivity_window(schedule)


@given(schedules())
def test_the_refusal_names_learners_that_never_hear_of_each_other(schedule: EdgeSchedule) -> None:
    union = network((len(schedule.learners), frozenset(schedule.all_edges)))
    assume(not nx.is_strongly_connected(union))
    with pytest.raises(ScheduleError) as caught:
        connectivity_window(schedule)
    message = str(caught.value)
    silent = [
        f"nothing that {schedule.learners[u]} knows ever reaches {schedule.learners[v]}: the union of all slots is not"
        for u in union
        for v in union
        if not nx.has_path(union, u, v)
    ]
    assert any(message.startswith(opening) for opening in silent)


def test_windows_wrap_around_the_end_of_the_period() -> None:
    """Slots AB, AB, nothing, nothing: the window of slots 3, 4 needs a third, slots 3, 4, 1."""
    edge, nothing = both_ways([(0, 1)]), frozenset[Edge]()
    assert connectivity_window(EdgeSchedule(("a", "b"), (edge, edge, nothing, nothing))) == 3
    assert connectivity_window(EdgeSchedule(("a", "b"), (nothing, edge, edge, nothing))) == 3
    assert connectivity_window(EdgeSchedule(("a", "b"), (edge, nothing, edge, nothing))) == 2


def test_a_learner_alone_is_connected() -> None:
    assert validate(EdgeSchedule(("a",), (frozenset(),))).connectivity_window == 1


@pytest.mark.parametrize("count", range(2, 9))
def test_an_alternating_ring_satisfies_both_assumptions(count: int) -> None:
    schedule = alternating_ring(learners(count))
    report = validate(schedule)
    assert every_window_is_connected(schedule, report.connectivity_window)
    assert not every_window_is_connected(schedule, report.connectivity_window - 1)
    assert report.smallest_weight == 1 / 2
    assert report.largest_sum_error <= 1e-12


@pytest.mark.parametrize("count", range(2, 9))
def test_an_alternating_ring_opens_each_edge_of_the_ring_in_one_slot_and_pairs_learners(count: int) -> None:
    schedule = alternating_ring(learners(count))
    opened = [edge for slot in schedule.slots for edge in slot]
    assert sorted(opened) == sorted(both_ways(ring_edges(count)))
    for slot in schedule.slots:
        senders = [sender for sender, _ in slot]
        assert len(senders) == len(set(senders))


def test_two_learners_in_turns_talk_at_every_other_iteration() -> None:
    schedule = alternating_ring(("a", "b"))
    assert [bool(schedule.edges(n)) for n in range(1, 5)] == [True, False, True, False]


@given(schedules(), st.integers(1, 20))
def test_iteration_n_uses_slot_n_minus_one_modulo_the_period(schedule: EdgeSchedule, n: int) -> None:
    assert schedule.edges(1) == schedule.slots[0]
    assert schedule.edges(n) == schedule.slots[(n - 1) % len(schedule.slots)]
    assert schedule.edges(n + len(schedule.slots)) == schedule.edges(n)


@given(schedules())
def test_in_neighbours_are_the_senders_of_the_edges_to_a_learner(schedule: EdgeSchedule) -> None:
    for learner in range(len(schedule.learners)):
        ever: set[int] = set()
        for n in range(1, len(schedule.slots) + 1):
            expected = sorted(network((len(schedule.learners), schedule.edges(n))).predecessors(learner))
            assert schedule.in_neighbours(learner, n) == expected
            ever.update(expected)
        assert schedule.all_in_neighbours(learner) == sorted(ever)


def test_the_edges_of_all_slots_are_sorted_and_named_once() -> None:
    assert TALKING.all_edges == [(0, 1), (0, 2), (1, 0), (1, 2), (2, 1)]
    everything = both_ways(complete_edges(9))
    assert EdgeSchedule(learners(9), (everything, everything)).all_edges == sorted(everything)


def test_nothing_hangs_on_the_order_in_which_edges_are_stored() -> None:
    edges = sorted(both_ways(complete_edges(9)))
    one, other = (EdgeSchedule(learners(9), (frozenset(order),)) for order in (edges, reversed(edges)))
    assert one.digest == other.digest
    assert one.all_in_neighbours(4) == other.in_neighbours(4, 1) == [0, 1, 2, 3, 5, 6, 7, 8]
    assert EdgeSchedule(learners(9), (both_ways([(0, 8), (0, 1)]),)).all_in_neighbours(0) == [1, 8]


def test_in_neighbours_by_hand() -> None:
    assert [TALKING.in_neighbours(1, n) for n in (1, 2, 3, 4)] == [[0, 2], [], [], [0, 2]]
    assert [TALKING.in_neighbours(2, n) for n in (1, 2, 3, 4)] == [[], [], [0, 1], []]
    assert [TALKING.all_in_neighbours(v) for v in range(3)] == [[1], [0, 2], [0, 1]]


def test_weights_follow_the_slots_of_the_period() -> None:
    schedule = EdgeSchedule(NAMES, (both_ways([(0, 1)]), frozenset({(0, 1), (1, 2), (2, 0)})))
    pair = np.array([[0.5, 0.5, 0], [0.5, 0.5, 0], [0, 0, 1]])
    ring = np.array([[0.5, 0, 0.5], [0.5, 0.5, 0], [0, 0.5, 0.5]])
    for n, expected in enumerate([pair, ring, pair, ring], start=1):
        np.testing.assert_array_equal(schedule.weights(n), expected)


def test_weights_refuse_an_edge_on_no_cycle_by_the_learners_names() -> None:
    schedule = EdgeSchedule(("ann", "bob"), (both_ways([(0, 1)]), frozenset({(0, 1)})))
    with pytest.raises(ScheduleError, match="ann -> bob"):
        validate(schedule)


ROUND = EdgeSchedule(NAMES, (frozenset({(0, 1), (1, 2), (2, 0)}), both_ways([(0, 1)])))


@pytest.mark.parametrize(
    ("weights", "error"),
    [
        ([[0.5, 0.5 + 2**-38, 0], [0.5, 0.5, 0], [0, 0, 1]], "3.63798e-12"),
        ([[0.6, 0.4, 0], [0.5, 0.5, 0], [0, 0, 1]], "0.1"),
        ([[0.6, 0.5, 0], [0.4, 0.5, 0], [0, 0, 1]], "0.1"),
        ([[-1, 2, 0], [2, -1, 0], [0, 0, 1]], "0"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], "0"),
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], "0"),
        ([[0.4, 0.3, 0.3], [0.3, 0.4, 0.3], [0.3, 0.3, 0.4]], "0|1.11022e-16|2.22045e-16"),
    ],
    ids=[
        "hardly off",
        "columns",
        "rows",
        "negative",
        "an edge without",
        "nothing for oneself",
        "no edge, but a weight",
    ],
)
def test_weights_that_break_assumption_3_are_refused_by_slot(
    monkeypatch: pytest.MonkeyPatch, weights: list[list[float]], error: str
) -> None:
    sound = ROUND.weights(1)
    spoiled = {frozenset(ROUND.slots[0]): sound, frozenset(ROUND.slots[1]): np.array(weights, dtype=np.float64)}
    monkeypatch.setattr(schedule_module, "doubly_stochastic_weights", lambda _count, edges, _names: spoiled[edges])
    words = rf"slot 2: weights are not doubly stochastic on its edges \(sums off by ({error})\)"
    with pytest.raises(ScheduleError, match=words):
        validate(replace(ROUND))


def test_sums_that_are_off_by_rounding_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    almost = np.array([[0.5, 0.5 + 2**-42], [0.5, 0.5]])
    monkeypatch.setattr(schedule_module, "doubly_stochastic_weights", lambda *_: almost)
    pair = both_ways([(0, 1)])
    assert validate(EdgeSchedule(("a", "b"), (pair,))).largest_sum_error == 2**-42
    different = iter([almost, np.full((2, 2), 0.5)])
    monkeypatch.setattr(schedule_module, "doubly_stochastic_weights", lambda *_: next(different))
    assert validate(EdgeSchedule(("a", "b"), (pair, pair))).largest_sum_error == 2**-42


@pytest.mark.parametrize(
    ("count", "most"), [(1, 100_000), (7, 100_000), (8, 78_125), (100, 500), (2236, 1), (2237, 0), (10**6, 0)]
)
def test_more_slots_than_can_be_checked_in_seconds_are_refused(count: int, most: int) -> None:
    require_size(count, most)
    with pytest.raises(ScheduleError, match=f"{most + 1} slots: expected at most {most} for {count} learners"):
        require_size(count, most + 1)


def test_a_schedule_that_is_too_large_is_refused_before_anything_else_of_its_edges() -> None:
    with pytest.raises(ScheduleError, match="501 slots: expected at most 500 for 100 learners; take fewer"):
        EdgeSchedule(learners(100), (frozenset({(0, 0)}),) * 501)


def test_a_schedule_that_stops_has_neither_neighbours_nor_weights_after_its_last_slot() -> None:
    schedule = EdgeSchedule(("a", "b"), (frozenset(), both_ways([(0, 1)])), end="stop")
    assert [schedule.in_neighbours(0, n) for n in (1, 2, 3, 4)] == [[], [1], [], []]
    assert schedule.weights(2)[0, 1] == 1 / 2
    with pytest.raises(ScheduleError, match="iteration 3: the schedule stops after its 2 slots"):
        schedule.weights(3)
    assert [schedule.senders_to("a", n) for n in (1, 2, 3, 4)] == [[], ["b"], [], []]
    assert [schedule.receivers_of("a", n) for n in (1, 2, 3, 4)] == [[], ["b"], [], []]


@pytest.mark.parametrize("rest", [0, 1])
def test_long_lists_of_learners_are_shortened_in_messages(rest: int) -> None:
    name = "x" * (400 - len("['', '']") - 1 + rest)
    with pytest.raises(ScheduleError) as caught:
        EdgeSchedule((name, "y"), (frozenset({(0, 2)}),))
    assert (str([name, "y"]) in str(caught.value)) == (rest == 0)


def test_strangers_are_refused_by_name() -> None:
    with pytest.raises(ScheduleError, match=r"\['x', 'y', 'z'\]: expected learners of \('a', 'b', 'c'\)"):
        delivered_edges(TALKING, [["z", "a"], ["x"], ["y", "x"]])


def test_validate_reports_the_window_and_the_smallest_weight() -> None:
    schedule = EdgeSchedule(learners(4), (both_ways([(0, 1), (0, 2), (0, 3)]), frozenset()))
    report = validate(schedule)
    assert report.connectivity_window == 2
    assert report.smallest_weight == pytest.approx(1 / 4)
    other_way_round = EdgeSchedule(learners(4), tuple(reversed(schedule.slots)))
    assert validate(other_way_round).smallest_weight == report.smallest_weight


@given(schedules(), schedules())
def test_digests_differ_if_and_only_if_the_schedules_do(one: EdgeSchedule, other: EdgeSchedule) -> None:
    assert (one.digest == other.digest) == (one == other)


def test_a_digest_is_that_of_learners_slots_and_end() -> None:
    """Files hold it: a recorded content, so that no change of code goes unnoticed."""
    schedule = EdgeSchedule(("a", "b"), (frozenset({(1, 0), (0, 1)}), frozenset()), end="hold")
    content = {"learners": ["a", "b"], "slots": [[[0, 1], [1, 0]], []], "end": "hold"}
    assert schedule.digest == digest(content)


def test_receivers_come_in_the_order_of_the_learners() -> None:
    names = learners(9)
    schedule = EdgeSchedule(names, (frozenset((4, v) for v in (8, 0, 5, 1, 7)) | {(0, 4)},))
    assert schedule.receivers_of(names[4], 1) == [names[v] for v in (0, 1, 5, 7, 8)]
    assert schedule.receivers_of(names[0], 1) == [names[4]]


def test_digests_see_direction_order_and_names() -> None:
    there, back = frozenset({(0, 1)}), frozenset({(1, 0)})
    variants = [
        EdgeSchedule(("a", "b"), (there, back)),
        EdgeSchedule(("a", "b"), (back, there)),
        EdgeSchedule(("a", "b"), (there | back,)),
        EdgeSchedule(("b", "a"), (there, back)),
        EdgeSchedule(("a", "b", "c"), (there, back)),
    ]
    assert len({schedule.digest for schedule in variants}) == len(variants)
    assert EdgeSchedule(("a", "b"), (there, back)).digest == variants[0].digest


@pytest.mark.parametrize(
    ("names", "slots", "message"),
    [
        (("a", "a"), [[]], r"learners \['a', 'a'\]: expected at least one, each named once"),
        ((), [[]], r"learners \[\]: expected at least one"),
        (("a", "b"), [], "expected at least one slot"),
        (("a", "b"), [[(0, 1)], [(1, 1)]], "edge b -> b: expected two different learners"),
        (("a", "b"), [[(0, 2)]], "edge a -> learner number 2: expected two different learners"),
        (("a", "b"), [[(-1, 1)]], "edge learner number -1 -> b: expected two different learners"),
    ],
)
def test_impossible_schedules_are_refused_by_value(
    names: tuple[str, ...], slots: list[list[Edge]], message: str
) -> None:
    with pytest.raises(ScheduleError, match=message):
        EdgeSchedule(names, tuple(frozenset(slot) for slot in slots))


@pytest.mark.parametrize("count", range(1, 9))
def test_rings_and_complete_graphs_are_those_of_networkx(count: int) -> None:
    complete = {frozenset(edge) for edge in nx.complete_graph(count).edges}
    assert [frozenset(edge) for edge in complete_edges(count)] == sorted(complete, key=sorted)
    ring = {frozenset(edge) for edge in nx.cycle_graph(count).edges if count > 1}
    assert sorted(map(sorted, ring_edges(count))) == sorted(map(sorted, ring))


def test_a_static_schedule_opens_every_edge_both_ways_at_every_iteration() -> None:
    schedule = static(NAMES, [(0, 1), (1, 2)])
    for n in (1, 2, 9):
        assert schedule.edges(n) == {(0, 1), (1, 0), (1, 2), (2, 1)}
