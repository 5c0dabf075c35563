"""Windows of a schedule against brute force: how long they must be, and how much of disagreement they leave."""

from collections.abc import Iterator
from typing import get_args

import networkx as nx
import numpy as np
import pytest
from graphs import network
from hypothesis import assume, given
from hypothesis import strategies as st

from mabirds_core.consensus.assumptions import connectivity_window, contraction, unreachable, validate
from mabirds_core.consensus.generators import complete_edges, ring_edges
from mabirds_core.consensus.schedule import EdgeSchedule, End, both_ways
from mabirds_core.consensus.weights import Edge


def learners(count: int) -> tuple[str, ...]:
    return tuple(f"learner_{v + 1}" for v in range(count))


@st.composite
def connected_schedules(draw: st.DrawFn) -> EdgeSchedule:
    """One to five slots of undirected edges among one to four learners, with any end, that connect all in time."""
    count = draw(st.integers(1, 4))
    pairs = complete_edges(count)
    some = st.frozensets(st.sampled_from(pairs)) if pairs else st.just(frozenset[Edge]())
    *first, last = draw(st.lists(some, min_size=1, max_size=5))
    end: End = draw(st.sampled_from(get_args(End)))
    closing = last | set(ring_edges(count)) if end == "hold" or not draw(st.booleans()) else last
    schedule = EdgeSchedule(learners(count), tuple(map(both_ways, map(sorted, [*first, closing]))), end)
    assume(unreachable(count, frozenset(schedule.all_edges)) is None)
    return schedule


def windows(schedule: EdgeSchedule, length: int) -> Iterator[range]:
    """All windows of that many iterations; of a schedule without end those that begin in its first three rounds."""
    period = len(schedule.slots)
    last = period - length + 1 if schedule.end == "stop" else 3 * period
    return (range(n, n + length) for n in range(1, last + 1))


@given(connected_schedules())
def test_window_and_contraction_are_those_of_brute_force_whatever_follows_the_last_slot(schedule: EdgeSchedule) -> None:
    def connects(window: range) -> bool:
        union = frozenset().union(*(schedule.edges(n) for n in window))
        return nx.is_strongly_connected(network((len(schedule.learners), union)))

    lengths = range(1, len(schedule.slots) + 1)
    smallest = next(length for length in lengths if all(map(connects, windows(schedule, length))))
    report = validate(schedule)
    assert report.connectivity_window == connectivity_window(schedule) == smallest
    worst = max(contraction([schedule.weights(n) for n in window]) for window in windows(schedule, smallest))
    assert report.contraction == pytest.approx(worst, abs=1e-12)
    assert report.contraction < 1


def test_the_contraction_multiplies_later_weights_from_the_left() -> None:
    """Weights of directed edges are not symmetric, so that the order of a window's factors is seen."""
    cycle, pair = frozenset({(0, 1), (1, 2), (2, 3), (3, 0)}), both_ways([(0, 1)])
    triangle = frozenset({(0, 2), (2, 1), (1, 0), (0, 1), (1, 2)})
    other = both_ways([(2, 3)])
    slots = (pair, triangle, other, cycle, other, pair)
    schedule = EdgeSchedule(learners(4), slots)
    length, norms = connectivity_window(schedule), []
    for start in range(1, len(slots) + 1):
        product = np.eye(4)
        for n in range(start, start + length):
            product = schedule.weights(n) @ product
        norms.append(np.linalg.norm(product - 1 / 4, ord=2))
    for first in range(len(slots)):  # whichever window begins the period, the worst is the same
        rotated = EdgeSchedule(learners(4), (*slots[first:], *slots[:first]))
        assert validate(rotated).contraction == pytest.approx(max(norms), abs=1e-12)
    matrices = [schedule.weights(n) for n in range(1, length + 1)]
    assert contraction(matrices) == pytest.approx(norms[0], abs=1e-12)
    assert contraction(matrices[::-1]) != pytest.approx(norms[0], abs=1e-3)
