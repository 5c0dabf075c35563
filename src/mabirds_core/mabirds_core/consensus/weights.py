"""Doubly stochastic mixing weights W for one slot's edges (paper, Assumption 3).

W[v, u] is the weight that learner v gives to learner u; W 1 = 1 and 1^T W = 1^T. Three rules, the first that fits:

- symmetric slot (every edge both ways): W[v, u] = 1 / (1 + max(d_v, d_u)), the Metropolis weights;
- balanced slot (as many edges into a learner as out of it): W[v, u] = 1 / (1 + D), D the largest degree;
- any other slot: a circulation. One directed cycle through each edge, summed, gives every edge a flow c >= 1
  that enters and leaves each learner alike; W[v, u] = c_uv / (1 + F), F the largest flow through a learner.

An edge on no directed cycle fits no doubly stochastic W and is refused by name.
"""

from collections import defaultdict, deque
from collections.abc import Iterable, Sequence

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.errors import ScheduleError

Edge = tuple[int, int]
"""(sender, receiver), as indices into the list of learners."""


def doubly_stochastic_weights(n_learners: int, edges: Iterable[Edge], names: Sequence[str] | None = None) -> Array:
    """W of one slot.

    Parameters
    ----------
    n_learners : int
        N_L.
    edges : Iterable[Edge]
        Of the slot.
    names : Sequence[str], optional
        Of the learners, for messages; default: their indices.

    Returns
    -------
    Array
        W[v, u], shape (N_L, N_L).

    Raises
    ------
    ScheduleError
        An edge is on no directed cycle.
    """
    edges = sorted(set(edges))
    out_degree, in_degree = (np.bincount([edge[end] for edge in edges], minlength=n_learners) for end in (0, 1))
    weights = np.zeros((n_learners, n_learners))
    if {(receiver, sender) for sender, receiver in edges} == set(edges):
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
    flow, lost = np.zeros((n_learners, n_learners)), list[Edge]()
    successors = _by_first(edges)
    for start, senders in _by_first([(receiver, sender) for sender, receiver in edges]).items():
        before = _search(successors, start)
        for sender in senders:
            if sender not in before:
                lost.append((sender, start))
                continue
            flow[start, sender] += 1
            here = sender
            while here != start:
                flow[here, before[here]] += 1
                here = before[here]
    if lost:
        tail, head = (names[learner] for learner in min(lost))
        raise ScheduleError(
            f"edge {tail} -> {head} lies on no directed cycle of its slot, so no doubly stochastic weights exist;"
            f" add a way back from {head} to {tail}"
        )
    return flow


def _by_first(pairs: Iterable[Edge]) -> dict[int, list[int]]:
    """The second ones of the pairs by the first, in the order of the pairs."""
    by_first = defaultdict[int, list[int]](list)
    for first, second in pairs:
        by_first[first].append(second)
    return by_first


def _search(successors: dict[int, list[int]], start: int) -> dict[int, int]:
    """The learner before each one on a shortest directed way to it from ``start``; breadth first."""
    before, queue = {start: start}, deque([start])
    while queue:
        here = queue.popleft()
        for head in successors.get(here, ()):
            if head not in before:
                before[head] = here
                queue.append(head)
    return before
