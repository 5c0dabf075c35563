"""Doubly stochastic mixing weights W for one slot's edges (paper, Assumption 3).

W[v, u] is the weight that learner v gives to learner u; W 1 = 1 and 1^T W = 1^T. Three rules, the first that fits:

- symmetric slot (every edge both ways): W[v, u] = 1 / (1 + max(d_v, d_u)), the Metropolis weights;
- balanced slot (as many edges into a learner as out of it): W[v, u] = 1 / (1 + D), D the largest degree;
- any other slot: a circulation. One directed cycle through each edge, summed, gives every edge a flow c >= 1
  that enters and leaves each learner alike; W[v, u] = c_uv / (1 + F), F the largest flow through a learner.

An edge on no directed cycle fits no doubly stochastic W and is refused by name.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.errors import ScheduleError

Edge = tuple[int, int]
"""(sender, receiver), as indices into the list of learners."""


def doubly_stochastic_weights(n_learners: int, edges: Iterable[Edge], names: Sequence[str] | None = None) -> Array:
    """W of one slot, shape (n_learners, n_learners). Raises ScheduleError for an edge on no directed cycle."""
    edges = sorted(set(edges))
    out_degree, in_degree = (np.bincount([edge[end] for edge in edges], minlength=n_learners) for end in (0, 1))
    weights = np.zeros((n_learners, n_learners))
    if all((receiver, sender) in edges for sender, receiver in edges):
        for sender, receiver in edges:
            weights[receiver, sender] = 1 / (1 + max(in_degree[sender], in_degree[receiver]))
    elif (out_degree == in_degree).all():
        for sender, receiver in edges:
            weights[receiver, sender] = 1 / (1 + in_degree.max())
    else:
        flow = _circulation(n_learners, edges, names or [str(v) for v in range(n_learners)])
        weights = flow / (1 + flow.sum(axis=1).max())
    # On the diagonal what is left of 1.
    weights[np.diag_indices(n_learners)] = 1 - weights.sum(axis=1)
    return weights


def _circulation(n_learners: int, edges: list[Edge], names: Sequence[str]) -> Array:
    """flow[receiver, sender]: one shortest directed cycle through every edge, summed."""
    flow = np.zeros((n_learners, n_learners))
    for sender, receiver in edges:
        way_back = _shortest_path(edges, receiver, sender)
        if way_back is None:
            raise ScheduleError(
                f"edge {names[sender]} -> {names[receiver]} lies on no directed cycle of its slot, so no doubly"
                f" stochastic weights exist; add a way back from {names[receiver]} to {names[sender]}"
            )
        cycle = [sender, *way_back]
        for tail, head in pairwise(cycle):
            flow[head, tail] += 1
    return flow


def _shortest_path(edges: list[Edge], start: int, end: int) -> list[int] | None:
    """Learners from ``start`` to ``end`` along directed edges, or None; breadth first."""
    paths = {start: [start]}
    queue = deque([start])
    while queue and end not in paths:
        here = queue.popleft()
        for tail, head in edges:
            if tail == here and head not in paths:
                paths[head] = [*paths[here], head]
                queue.append(head)
    return paths.get(end)
