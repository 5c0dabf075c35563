"""Drawing a cell for each of several drones that are coupled by pairs, with a density that is known.

    log pi(c_1, .., c_N) = sum_i s_i(c_i) + sum_{i<j} A_ij(c_i, c_j) - log sum exp

Two drones are drawn together, then each further one given those before. What drone l, still to be drawn, makes of the
choice of the others is in their scores: log sum_c exp( s_l(c) + sum_j A_jl(c_j, c) ), a product of two matrices. So
three drones are drawn exactly as above. Of more it is left out what those still to be drawn cost each other; pi is what
is drawn from, and known, all the same.
"""

from collections.abc import Mapping

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.drones.coupling import LEAST
from mabirds_core.games.drones.lone_fields import Float


def drawn_cells(
    scores: list[Float], couplings: Mapping[tuple[int, int], Float], uniform: list[Array]
) -> tuple[list[Indices], Vector]:
    """Draw them.

    Parameters
    ----------
    scores : list[Float]
        s_i of M joint states, shape (M, K) each.
    couplings : Mapping[tuple[int, int], Float]
        A_ij by i < j, shape (M, K, K) each; none where drones do not matter to each other any more.
    uniform : list[Array]
        In [0, 1), shape (M, 1) each: one for every drone, two for a single one.

    Returns
    -------
    cells : list[Indices]
        Of each drone, shape (M,).
    log_pi : Vector
        Shape (M,).
    """
    rows, joint = np.arange(len(scores[0])), _of_two(scores, couplings)
    for later in range(2, len(scores)) if couplings else ():
        joint += _of_both(scores[later], couplings[0, later], couplings[1, later])
    chances, totals = exponentials(joint)
    first = drawn_columns(chances.sum(axis=2), uniform[0])
    second = drawn_columns(chances[rows, first], uniform[1])
    cells, log_pi = [first, second][: len(scores)], joint[rows, first, second] - totals
    for drone in range(2, len(scores)):
        given = _given(drone, scores[drone], couplings, cells)
        ahead = given.copy()
        for later in range(drone + 1, len(scores)) if couplings else ():
            ahead += _of_one(_given(later, scores[later], couplings, cells), couplings[drone, later])
        chances, totals = exponentials(ahead)
        cells.append(drawn_columns(chances, uniform[drone]))
        log_pi += ahead[rows, cells[drone]] - totals
    return cells, log_pi


def exponentials(scores: Array | Float) -> tuple[Array, Vector]:
    """exp of scores, each less the largest of its row, and log of the sum of exp of each row.

    Parameters
    ----------
    scores : Array or Float
        Shape (M, ...).

    Returns
    -------
    chances : Array
        Of the same shape.
    totals : Vector
        Shape (M,).
    """
    rows = scores.reshape(len(scores), -1)
    most = rows.max(axis=1)
    chances = np.exp(rows - most[:, None])
    return chances.reshape(scores.shape), most + np.log(chances.sum(axis=1, dtype=np.float64))


def drawn_columns(chances: Array, uniform: Array) -> Indices:
    """Draw a column of each row.

    Parameters
    ----------
    chances : Array
        They need not add up to 1, shape (M, K).
    uniform : Array
        In [0, 1), shape (M, 1).

    Returns
    -------
    Indices
        Shape (M,).
    """
    cumulative = chances.cumsum(axis=1, dtype=np.float64)
    columns = (cumulative <= uniform * cumulative[:, -1:]).sum(axis=1)
    return np.asarray(np.minimum(columns, chances.shape[1] - 1))


def _of_two(scores: list[Float], couplings: Mapping[tuple[int, int], Float]) -> Float:
    """s_1 + s_2 + A_12, shape (M, K, K); of a single drone s_1, shape (M, K, 1)."""
    if len(scores) == 1:
        return scores[0][:, :, None]
    joint = scores[0][:, :, None] + scores[1][:, None, :]
    return joint + couplings[0, 1] if couplings else joint


def _given(drone: int, scores: Float, couplings: Mapping[tuple[int, int], Float], cells: list[Indices]) -> Float:
    """A drone's scores (M, K) with those of its couplings to the drones that are drawn."""
    rows = np.arange(len(scores))
    for before, chosen in enumerate(cells) if couplings else ():
        scores = scores + couplings[before, drone][rows, chosen]
    return scores


def _of_one(scores: Float, coupling: Float) -> Float:
    """log sum_c exp( s(c) + A(a, c) ), shape (M, K)."""
    joint = scores[:, None, :] + coupling
    most = joint.max(axis=2)
    return np.asarray(most + np.log(np.exp(joint - most[:, :, None]).sum(axis=2)))


def _of_both(scores: Float, first: Float, second: Float) -> Float:
    """log sum_c exp( s(c) + A_1(a, c) + A_2(b, c) ), shape (M, K, K)."""
    one = scores[:, None, :] + first
    most, other = one.max(axis=2), second.max(axis=2)
    sums = np.exp(one - most[:, :, None]) @ np.exp(second - other[:, :, None]).transpose(0, 2, 1)
    return np.asarray(np.log(np.maximum(sums, LEAST)) + most[:, :, None] + other[:, None, :])
