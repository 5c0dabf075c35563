"""Random graphs and schedules for property tests, as hypothesis strategies."""

from itertools import permutations

import networkx as nx
from hypothesis import strategies as st

from mabirds_core.consensus.schedule import EdgeSchedule, both_ways
from mabirds_core.consensus.weights import Edge

Graph = tuple[int, frozenset[Edge]]
"""Number of learners, directed edges."""


def cycle_edges(nodes: list[int]) -> list[Edge]:
    """The directed cycle through the nodes."""
    return list(zip(nodes, [*nodes[1:], nodes[0]], strict=True))


def network(graph: Graph) -> "nx.DiGraph[int]":
    """The graph as the independent library's."""
    n_learners, edges = graph
    built = nx.DiGraph()
    built.add_nodes_from(range(n_learners))
    built.add_edges_from(edges)
    return built


@st.composite
def digraphs(draw: st.DrawFn, largest: int = 6) -> Graph:
    """Any directed graph."""
    count = draw(st.integers(1, largest))
    pairs = list(permutations(range(count), 2))
    return count, draw(st.frozensets(st.sampled_from(pairs))) if pairs else frozenset()


@st.composite
def undirected_graphs(draw: st.DrawFn) -> Graph:
    """Every edge both ways."""
    count, edges = draw(digraphs(largest=8))
    return count, both_ways(sorted(edges))


@st.composite
def cycles(draw: st.DrawFn) -> tuple[int, list[list[Edge]]]:
    """One to four directed cycles among up to eight learners."""
    count = draw(st.integers(2, 8))
    nodes = st.lists(st.integers(0, count - 1), min_size=2, max_size=count, unique=True)
    return count, [cycle_edges(one) for one in draw(st.lists(nodes, min_size=1, max_size=4))]


@st.composite
def unions_of_cycles(draw: st.DrawFn) -> Graph:
    """Directed cycles that may share edges."""
    count, parts = draw(cycles())
    return count, frozenset(edge for part in parts for edge in part)


@st.composite
def balanced_digraphs(draw: st.DrawFn) -> Graph:
    """Directed cycles that share no edge: as many edges into each learner as out of it."""
    count, parts = draw(cycles())
    kept: set[Edge] = set()
    for part in parts:
        if kept.isdisjoint(part):
            kept.update(part)
    return count, frozenset(kept)


@st.composite
def schedules(draw: st.DrawFn) -> EdgeSchedule:
    """One to four slots of any directed edges among two to five learners."""
    count = draw(st.integers(2, 5))
    pairs = list(permutations(range(count), 2))
    slots = draw(st.lists(st.frozensets(st.sampled_from(pairs), max_size=6), min_size=1, max_size=4))
    return EdgeSchedule(tuple(f"learner_{v + 1}" for v in range(count)), tuple(slots))
