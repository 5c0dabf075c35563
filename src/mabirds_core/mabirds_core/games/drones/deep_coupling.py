"""What two drones cost each other, however much: C_t of ``coupling`` in float64, every sum scaled by its largest term.

    C_t = r_12 + log sum_{a_1, a_2} exp( log P^1_t(a_1) + log P^2_t(a_2) + gamma C_{t+1}(s'_1, s'_2) )

Some twenty times as slow as kernels in float32, and with twice the memory. It is for rewards and costs that make drones
do what each of them alone would do with a chance below exp(-60).
"""

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.games.drones.coupling import Codes, LogKernel, PairProblem, Table

STRIP = 64
"""Rows that are summed at once."""


def deep_codes(problem: PairProblem) -> int:
    """How many 16-bit codes' memory ``couple_deeply`` takes."""
    return 2 * problem.codes


def couple_deeply(problem: PairProblem, memory: Codes) -> list[Table]:
    """C_t for t = 1 .. T.

    Parameters
    ----------
    problem : PairProblem
        What decides them.
    memory : Codes
        In which they are kept, at least ``deep_codes`` long.

    Returns
    -------
    list[Table]
        The first is C_1.
    """
    ahead, tables, end = np.zeros(problem.sizes[:, -1]), list[Table](), 0
    kept = memory[: deep_codes(problem)].view(np.float32)
    for step in range(problem.sizes.shape[1] - 1, 0, -1):
        values = _backed_up(problem, step, ahead)
        below = kept[end : (end := end + values.size)].reshape(values.shape)
        tables.append(Table(below, top := float(values.max()), swapped=False, unit=1.0))
        np.subtract(top, values, out=below, casting="same_kind")
        ahead = values
    return tables[::-1]


def _backed_up(problem: PairProblem, step: int, ahead: Array) -> Array:
    """C_t from C_{t+1}."""
    first, second = (problem.log_kernel(i, step) for i in range(2))
    half = log_sums(first, problem.discount * ahead)
    values = log_sums(second, np.ascontiguousarray(half.T)).T
    return np.asarray(values + problem.rewards[: values.shape[0], : values.shape[1]])


def log_sums(kernel: LogKernel, values: Array) -> Array:
    """log sum_a P(a) exp(values) where moves lead.

    Parameters
    ----------
    kernel : LogKernel
        P of n places.
    values : Array
        By node, shape (S, M).

    Returns
    -------
    Array
        Shape (n, M).
    """
    result = np.empty((len(kernel.nodes), values.shape[1]))
    for first in range(0, len(result), STRIP):
        rows = slice(first, first + STRIP)
        terms = kernel.logs[rows, :, None] + values[kernel.nodes[rows]]
        most = terms.max(axis=1)
        terms -= most[:, None]
        result[rows] = most + np.log(np.exp(terms, out=terms).sum(axis=1))
    return result
