"""Schedules by rule, and what follows the last slot."""

import networkx as nx
import numpy as np
import pytest
from experiments import experiment
from graphs import network
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from mabirds_core.consensus.assumptions import connectivity_window, contraction, validate
from mabirds_core.consensus.generators import directed_ring, gossip, random_matching
from mabirds_core.consensus.schedule import EdgeSchedule, both_ways, delivered_edges, edge_mismatches
from mabirds_core.errors import ScheduleError

NAMES = ("a", "b", "c")
LINE = both_ways([(0, 1)]), both_ways([(1, 2)])


def learners(count: int) -> tuple[str, ...]:
    return tuple(f"l{number}" for number in range(count))


@pytest.mark.parametrize("count", [2, 3, 7])
def test_a_directed_ring_is_one_cycle_through_all(count: int) -> None:
    schedule = directed_ring(learners(count))
    assert schedule.slots == (frozenset((v, (v + 1) % count) for v in range(count)),)
    assert validate(schedule).connectivity_window == 1


def test_a_directed_ring_of_one_has_no_edge() -> None:
    assert directed_ring(("a",)).slots == (frozenset(),)


@given(st.integers(2, 9), st.integers(0, 1000))
def test_random_matchings_pair_all_learners_but_at_most_one(count: int, seed: int) -> None:
    schedule = random_matching(learners(count), 12, seed)
    for slot in schedule.slots:
        graph = network((count, slot))
        assert len(slot) == 2 * (count // 2)
        assert max(dict(graph.out_degree()).values()) == 1
        assert slot == both_ways(sorted(slot))
    assert connectivity_window(schedule) <= 12


@given(st.integers(2, 6), st.integers(0, 1000))
def test_gossip_opens_one_pair_a_slot_and_connects_all(count: int, seed: int) -> None:
    schedule = gossip(learners(count), 24, seed)
    assert {len(slot) for slot in schedule.slots} == {2}
    assert nx.is_strongly_connected(network((count, frozenset().union(*schedule.slots))))


def test_random_schedules_depend_on_their_seed_alone() -> None:
    one, again, other = (random_matching(learners(6), 8, seed) for seed in (1, 1, 2))
    assert one == again
    assert one != other


def test_too_few_slots_are_refused_with_a_number_that_may_do() -> None:
    with pytest.raises(ScheduleError, match="2 slots of 1 random pairs never connected 5 learners.*at least 4"):
        gossip(learners(5), 2, seed=0)


def test_a_schedule_that_repeats_begins_again() -> None:
    schedule = EdgeSchedule(NAMES, LINE)
    assert [schedule.edges(n) for n in range(1, 6)] == [LINE[0], LINE[1], LINE[0], LINE[1], LINE[0]]
    assert connectivity_window(schedule) == 2


def test_a_schedule_that_holds_keeps_its_last_slot() -> None:
    everything = LINE[0] | LINE[1]
    schedule = EdgeSchedule(NAMES, (*LINE, everything), end="hold")
    assert [schedule.edges(n) for n in range(1, 6)] == [*LINE, everything, everything, everything]
    np.testing.assert_array_equal(schedule.weights(9), schedule.weights(3))
    assert connectivity_window(schedule) == 2


def test_a_last_slot_that_is_held_must_connect_all() -> None:
    with pytest.raises(ScheduleError, match="ever reaches c: the last slot, which is held, is not strongly connected"):
        validate(EdgeSchedule(NAMES, (LINE[0] | LINE[1], LINE[0]), end="hold"))


def test_a_schedule_that_stops_has_no_iteration_after_its_slots() -> None:
    schedule = EdgeSchedule(NAMES, LINE, end="stop")
    assert schedule.edges(2) == LINE[1]
    with pytest.raises(ScheduleError, match="iteration 3: the schedule stops after its 2 slots; add slots"):
        schedule.edges(3)


def test_windows_of_a_schedule_that_stops_do_not_wrap_around() -> None:
    edge, nothing = both_ways([(0, 1)]), frozenset[tuple[int, int]]()
    slots = (nothing, edge, nothing)
    assert connectivity_window(EdgeSchedule(("a", "b"), slots, end="stop")) == 2
    assert connectivity_window(EdgeSchedule(("a", "b"), slots)) == 3


def test_ends_are_told_apart_by_digest() -> None:
    ends = [EdgeSchedule(NAMES, LINE, end).digest for end in ("repeat", "stop", "hold")]
    assert len(set(ends)) == 3


def test_the_contraction_is_the_worst_factor_on_disagreement() -> None:
    rng = np.random.default_rng(0)
    schedule = EdgeSchedule(NAMES, LINE)
    matrices = [schedule.weights(1), schedule.weights(2)]
    found = contraction(matrices)
    disagreements = rng.normal(size=(1000, 3))
    disagreements -= disagreements.mean(axis=1, keepdims=True)
    after = disagreements @ (matrices[1] @ matrices[0]).T
    factors = np.linalg.norm(after, axis=1) / np.linalg.norm(disagreements, axis=1)
    assert factors.max() <= found + 1e-12
    assert factors.max() > 0.95 * found
    assert contraction([np.full((3, 3), 1 / 3)]) == pytest.approx(0, abs=1e-12)
    assert contraction([np.eye(3)]) == pytest.approx(1)


@pytest.mark.parametrize("kind", ["random_matching", "gossip"])
def test_an_experiment_draws_its_schedule(kind: str) -> None:
    settings = experiment({"schedule": {"kind": kind, "slots": 9, "seed": 4}})
    generator = {"random_matching": random_matching, "gossip": gossip}[kind]
    assert settings.edge_schedule == generator(settings.learners, 9, 4)


def test_an_experiment_may_not_run_past_a_schedule_that_stops() -> None:
    slots = [[["ann", "bob"], ["bob", "cid"]]] * 12
    schedule = {"kind": "slots", "undirected": True, "slots": slots, "end": "stop"}
    assert experiment({"schedule": schedule}).edge_schedule.end == "stop"
    with pytest.raises(ValidationError, match="iteration 13: the schedule stops after its 12 slots"):
        experiment({"schedule": schedule, "closing_rounds": 1})


@pytest.mark.parametrize("end", ["repeat", "hold", "stop"])
def test_an_experiment_says_what_follows_the_last_slot(end: str) -> None:
    schedule = {"kind": "slots", "undirected": True, "slots": [[["ann", "bob"], ["bob", "cid"]]] * 12}
    assert experiment({"schedule": {**schedule, "end": end}}).edge_schedule.end == end
    assert experiment({"schedule": schedule}).edge_schedule.end == EdgeSchedule(NAMES, LINE).end == "repeat"


def test_the_delivered_graph_is_what_learners_mixed() -> None:
    schedule = EdgeSchedule(NAMES, LINE)
    as_scheduled = {1: [["b"], ["a"], []], 2: [[], ["c"], ["b"]], 5: [["b"], ["a"], []]}
    assert [delivered_edges(schedule, senders) for senders in as_scheduled.values()] == [LINE[0], LINE[1], LINE[0]]
    assert edge_mismatches(schedule, as_scheduled) == []


def test_what_differs_from_the_schedule_is_named() -> None:
    schedule = EdgeSchedule(NAMES, LINE)
    assert edge_mismatches(schedule, {2: [["c"], ["c"], ["b"]], 1: [["b"], [], []]}) == [
        "iteration 1: a -> b not delivered",
        "iteration 2: c -> a delivered, not scheduled",
    ]
