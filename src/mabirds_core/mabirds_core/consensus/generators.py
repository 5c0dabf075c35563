"""Schedules by rule: what most networks need, without writing slots by hand."""

from collections.abc import Sequence

import numpy as np

from mabirds_core.consensus.assumptions import unreachable
from mabirds_core.consensus.schedule import EdgeSchedule, both_ways, require_size
from mabirds_core.consensus.weights import Edge
from mabirds_core.errors import ScheduleError

MAX_DRAWS = 1000
"""Attempts at a random schedule whose union connects all learners."""


def static(learners: Sequence[str], edges: Sequence[Edge]) -> EdgeSchedule:
    """The same undirected graph at every iteration.

    Parameters
    ----------
    learners : Sequence[str]
        Names, in the order that ``edges`` counts.
    edges : Sequence[Edge]
        Pairs of learners, each named in one direction.

    Returns
    -------
    EdgeSchedule
        One slot with every edge both ways.
    """
    return EdgeSchedule(tuple(learners), (both_ways(edges),))


def complete_edges(n_learners: int) -> list[Edge]:
    """Every pair of learners once."""
    return [(u, v) for u in range(n_learners) for v in range(u + 1, n_learners)]


def ring_edges(n_learners: int) -> list[Edge]:
    """Each learner to the next, the last to the first; one pair where there are only two."""
    return sorted({(min(v, w), max(v, w)) for v in range(n_learners) for w in [(v + 1) % n_learners] if v != w})


def alternating_ring(learners: Sequence[str]) -> EdgeSchedule:
    """Every other edge of the ring, then the rest: (1,2)(3,4).. and (2,3)(4,1)..; an odd ring takes a third slot.

    With two learners the second slot has no edge: they talk at every other iteration.
    """
    count = len(learners)
    ring = [(v, (v + 1) % count) for v in range(count)] if count > 2 else [(0, 1)][: count - 1]
    slots = [ring[0::2], ring[1::2]]
    if count > 2 and count % 2:
        slots = [ring[0:-1:2], ring[1::2], ring[-1:]]
    return EdgeSchedule(tuple(learners), tuple(both_ways(slot) for slot in slots))


def directed_ring(learners: Sequence[str]) -> EdgeSchedule:
    """Each learner sends to the next, the last to the first, at every iteration."""
    count = len(learners)
    return EdgeSchedule(tuple(learners), (frozenset((v, (v + 1) % count) for v in range(count) if count > 1),))


def random_matching(learners: Sequence[str], slots: int, seed: int) -> EdgeSchedule:
    """Every slot pairs the learners at random, both ways; with an odd number one is left alone.

    Parameters
    ----------
    learners : Sequence[str]
        Names.
    slots : int
        How many are drawn.
    seed : int
        Of the draw.

    Returns
    -------
    EdgeSchedule
        Slots whose union connects all learners.

    Raises
    ------
    ScheduleError
        The slots are too few to connect them, or too many to be checked.
    """
    return _connected(learners, slots, seed, len(learners) // 2)


def gossip(learners: Sequence[str], slots: int, seed: int) -> EdgeSchedule:
    """Every slot opens one random pair, both ways.

    Parameters
    ----------
    learners : Sequence[str]
        Names.
    slots : int
        How many are drawn.
    seed : int
        Of the draw.

    Returns
    -------
    EdgeSchedule
        Slots whose union connects all learners.

    Raises
    ------
    ScheduleError
        The slots are too few to connect them, or too many to be checked.
    """
    return _connected(learners, slots, seed, 1)


def _connected(learners: Sequence[str], slots: int, seed: int, pairs: int) -> EdgeSchedule:
    """``slots`` slots of so many random disjoint pairs, drawn until their union connects all learners."""
    require_size(len(learners), slots)
    rng = np.random.default_rng(seed)
    enough = slots * pairs >= len(learners) - 1  # that many edges at least connect all
    for _ in range(MAX_DRAWS if enough else 0):
        drawn = [_random_pairs(len(learners), pairs, rng) for _ in range(slots)]
        if unreachable(len(learners), frozenset().union(*drawn)) is None:
            return EdgeSchedule(tuple(learners), tuple(drawn))
    raise ScheduleError(
        f"{slots} slots of {pairs} random pairs never connected {len(learners)} learners in {MAX_DRAWS} draws; take"
        f" more slots, at least {-(-(len(learners) - 1) // max(1, pairs))}"
    )


def _random_pairs(n_learners: int, pairs: int, rng: np.random.Generator) -> frozenset[Edge]:
    order = [int(learner) for learner in rng.permutation(n_learners)]
    return both_ways([(order[2 * k], order[2 * k + 1]) for k in range(min(pairs, n_learners // 2))])
