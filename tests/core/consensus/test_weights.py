"""Mixing weights on random graphs: doubly stochastic, on the edges only, and keeping the learners' mean."""

import networkx as nx
import numpy as np
import pytest
from graphs import (
    Graph,
    balanced_digraphs,
    cycle_edges,
    digraphs,
    network,
    undirected_graphs,
    unions_of_cycles,
)
from hypothesis import assume, event, given
from hypothesis import strategies as st

from mabirds_core.arrays import Array
from mabirds_core.consensus.weights import Edge, doubly_stochastic_weights
from mabirds_core.errors import ScheduleError

TOLERANCE = 1e-12

graphs_with_weights = st.one_of(undirected_graphs(), balanced_digraphs(), unions_of_cycles())


def weights_of(graph: Graph) -> Array:
    return doubly_stochastic_weights(*graph)


def assert_doubly_stochastic_on(graph: Graph, weights: Array) -> None:
    count, edges = graph
    assert weights.shape == (count, count)
    assert np.abs(weights.sum(axis=0) - 1).max() <= TOLERANCE
    assert np.abs(weights.sum(axis=1) - 1).max() <= TOLERANCE
    allowed = {(receiver, sender) for sender, receiver in edges} | {(v, v) for v in range(count)}
    assert {(int(v), int(u)) for v, u in np.argwhere(weights)} == allowed
    assert (weights >= 0).all()


@given(undirected_graphs())
def test_weights_of_undirected_graphs_are_doubly_stochastic_and_symmetric(graph: Graph) -> None:
    weights = weights_of(graph)
    assert_doubly_stochastic_on(graph, weights)
    np.testing.assert_array_equal(weights, weights.T)


@given(undirected_graphs())
def test_weights_of_undirected_graphs_are_the_metropolis_weights(graph: Graph) -> None:
    count, edges = graph
    degree, weights = [sum(sender == v for sender, _ in edges) for v in range(count)], weights_of(graph)
    for sender, receiver in edges:
        assert weights[receiver, sender] == 1 / (1 + max(degree[sender], degree[receiver]))


@given(balanced_digraphs())
def test_weights_of_balanced_digraphs_are_doubly_stochastic_and_equal_on_the_edges(graph: Graph) -> None:
    count, edges = graph
    assume(any((receiver, sender) not in edges for sender, receiver in edges))
    weights = weights_of(graph)
    assert_doubly_stochastic_on(graph, weights)
    largest = max(sum(receiver == v for _, receiver in edges) for v in range(count))
    assert {float(weights[receiver, sender]) for sender, receiver in edges} == {1 / (1 + largest)}


@given(unions_of_cycles())
def test_weights_of_unions_of_directed_cycles_are_doubly_stochastic(graph: Graph) -> None:
    built = network(graph)
    event("balanced" if all(built.in_degree(v) == built.out_degree(v) for v in built) else "unbalanced")
    assert_doubly_stochastic_on(graph, weights_of(graph))


@given(graphs_with_weights, st.integers(0, 2**32 - 1))
def test_mixing_keeps_the_mean_and_never_spreads_the_learners(graph: Graph, seed: int) -> None:
    before = np.random.default_rng(seed).normal(size=(graph[0], 3))
    after = weights_of(graph) @ before
    np.testing.assert_allclose(after.mean(axis=0), before.mean(axis=0), rtol=0, atol=TOLERANCE)
    assert (after.max(axis=0) <= before.max(axis=0) + TOLERANCE).all()
    assert (after.min(axis=0) >= before.min(axis=0) - TOLERANCE).all()


@given(digraphs())
def test_a_graph_is_refused_if_and_only_if_an_edge_lies_on_no_directed_cycle(graph: Graph) -> None:
    count, edges = graph
    parts = nx.strongly_connected_components(network(graph))
    component = {v: number for number, part in enumerate(parts) for v in part}
    one_way = {edge for edge in edges if component[edge[0]] != component[edge[1]]}
    names = [f"learner_{v + 1}" for v in range(count)]
    if not one_way:
        event("accepted")
        assert_doubly_stochastic_on(graph, doubly_stochastic_weights(count, edges, names))
        return
    with pytest.raises(ScheduleError) as caught:
        doubly_stochastic_weights(count, edges, names)
    culprits = [f"edge {names[u]} -> {names[v]} lies on no directed cycle" for u, v in one_way]
    assert any(str(caught.value).startswith(culprit) for culprit in culprits)


def test_the_refusal_names_the_edge_and_the_missing_way_back() -> None:
    with pytest.raises(ScheduleError, match=r"edge b -> c lies on no .*; add a way back from c to b"):
        doubly_stochastic_weights(3, [(0, 1), (1, 0), (1, 2)], ["a", "b", "c"])


def test_of_several_such_edges_the_first_is_named() -> None:
    with pytest.raises(ScheduleError, match="edge a -> c lies on no directed cycle"):
        doubly_stochastic_weights(4, [(3, 2), (1, 3), (0, 2)], list("abcd"))


def test_the_refusal_numbers_learners_without_names() -> None:
    with pytest.raises(ScheduleError, match="edge 0 -> 1 lies"):
        doubly_stochastic_weights(2, [(0, 1)])


def matrix(*rows: list[float]) -> Array:
    return np.array(rows)


@pytest.mark.parametrize(
    ("count", "edges", "expected"),
    [
        (1, [], matrix([1])),
        (2, [], matrix([1, 0], [0, 1])),
        (2, [(0, 1), (1, 0)], matrix([1 / 2, 1 / 2], [1 / 2, 1 / 2])),
        (
            3,
            [(0, 1), (1, 0), (1, 2), (2, 1)],
            matrix([2 / 3, 1 / 3, 0], [1 / 3, 1 / 3, 1 / 3], [0, 1 / 3, 2 / 3]),
        ),
        (3, cycle_edges([0, 1, 2]), matrix([1 / 2, 0, 1 / 2], [1 / 2, 1 / 2, 0], [0, 1 / 2, 1 / 2])),
        # 0 -> 1 lies on the cycles 0 1 0 and 0 1 2 0, each the shortest for two edges: flows 4, 2, 2, 2.
        (3, [(0, 1), (1, 0), (1, 2), (2, 0)], matrix([0.2, 0.4, 0.4], [0.8, 0.2, 0], [0, 0.4, 0.6])),
    ],
    ids=["alone", "no edge", "pair", "line", "directed ring", "unbalanced"],
)
def test_weights_by_hand(count: int, edges: list[Edge], expected: Array) -> None:
    np.testing.assert_allclose(doubly_stochastic_weights(count, edges), expected, rtol=0, atol=1e-15)


def test_the_flow_goes_around_the_shortest_cycle_of_every_edge() -> None:
    """0 -> 1 lies on the cycles 0 1 2 0 and 0 1 3 4 0; it takes the shorter, so each carries a flow of 3."""
    flow = {(0, 1): 3 + 3, (1, 2): 3, (2, 0): 3, (1, 3): 3, (3, 4): 3, (4, 0): 3}
    weights = doubly_stochastic_weights(5, flow)
    for (sender, receiver), share in flow.items():
        assert weights[receiver, sender] == pytest.approx(share / 7, abs=1e-15)
    assert np.diag(weights) == pytest.approx(np.array([1, 1, 4, 4, 4]) / 7, abs=1e-15)


def test_of_equally_short_cycles_the_one_through_the_first_learners_carries_the_flow() -> None:
    """2 -> 3 lies on 2 3 0 2 and on 2 3 1 2; whoever computes the weights takes the same of the two."""
    flow = {(2, 3): 5, (3, 0): 3, (0, 2): 3, (3, 1): 2, (1, 2): 2}
    weights = doubly_stochastic_weights(4, [(3, 1), (3, 0), (1, 2), (2, 3), (0, 2)])
    for (sender, receiver), share in flow.items():
        assert weights[receiver, sender] == pytest.approx(share / 6, abs=1e-15)


@given(graphs_with_weights)
def test_the_order_and_repetition_of_edges_change_no_bit(graph: Graph) -> None:
    count, edges = graph
    shuffled = [*sorted(edges, reverse=True), *edges]
    assert doubly_stochastic_weights(count, shuffled).tobytes() == weights_of(graph).tobytes()
