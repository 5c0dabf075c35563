"""The kernel of what two drones cost each other: its exp and log against double precision, its sums against numpy's."""

import ctypes

import numpy as np
import pytest

from mabirds_core.games.drones.coupling import (
    DEPTH,
    LANES,
    LEVELS,
    CompiledBackup,
    Kernel,
    Mover,
    NumpyBackup,
    PairProblem,
    Table,
    compiled,
    strip_indices,
    strips,
)
from mabirds_core.kernels.loading import library, pointer

LIBRARY = library()
pytestmark = pytest.mark.skipif(LIBRARY is None, reason="kernels are not compiled")

Float = np.ndarray


def encoded(values: Float, discount: float = 1.0) -> tuple[Float, np.ndarray]:
    """exp of discounted values that are 0 at most, and their codes below 0."""
    result, codes = values.astype(np.float32), np.empty(len(values), np.uint16)
    number = ctypes.c_float
    assert LIBRARY is not None
    LIBRARY.mabirds_encode(
        *(pointer(result, np.float32), ctypes.c_int64(len(values))),
        *(number(0.0), number(LEVELS / DEPTH), number(discount), number(0.0), pointer(codes, np.uint16)),
    )
    return result, codes


def units(values: Float, exact: Float) -> float:
    """Largest error in units in the last place."""
    return float((np.abs(values - exact) / np.spacing(np.abs(exact).astype(np.float32))).max())


@pytest.mark.parametrize("span", [1e-4, 1.0, 86.9])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_exp_is_within_two_units(span: float, sign: float) -> None:
    x = -np.random.default_rng(0).uniform(0, span, 100_000).astype(np.float32)
    assert units(encoded(x, sign)[0], np.exp(sign * x.astype(np.float64))) <= 2


def test_what_is_larger_than_the_largest_value_counts_as_that() -> None:
    assert [part.tolist() for part in encoded(np.array([0.5, 1e9]))] == [[1.0, 1.0], [0, 0]]


def test_what_is_too_small_is_nothing() -> None:
    assert encoded(np.array([-87.1, -1000.0]))[0].tolist() == [0.0, 0.0]


def test_codes_are_rounded_steps_down_to_the_depth() -> None:
    x = np.array([0.0, -0.0012, -0.0013, -1.0, -DEPTH, -1e6])
    assert encoded(x)[1].tolist() == [0, 0, 1, round(LEVELS / DEPTH), LEVELS, LEVELS]


@pytest.mark.parametrize("span", [1e-4, 0.7, 80.0])
def test_log_is_within_two_units(span: float) -> None:
    """By a backup of one drone that stays and has no choice: C_t = log x."""
    count = 10_000
    x = np.exp(np.random.default_rng(1).uniform(-span, span, count)).astype(np.float32)
    ahead = np.zeros((strips(count), LANES), np.float32)
    ahead.ravel()[:count] = x
    values, none = np.empty((count, LANES), np.float32), np.zeros((count, LANES), np.float32)
    kernels = stay(1), stay(count)
    compiled().mabirds_couple(
        *(ctypes.byref(Mover.of(kernel)) for kernel in kernels),
        *(pointer(ahead, np.float32), ctypes.c_int64(1), ctypes.c_int64(len(ahead))),
        *(pointer(none, np.float32), ctypes.c_int64(count), ctypes.c_float(0.0), pointer(values, np.float32)),
    )
    exact = np.log(x.astype(np.float64))
    assert (np.abs(values[:, 0] - exact) <= 2 * np.spacing(np.abs(exact).astype(np.float32)) + 1e-7 * span).all()


def stay(count: int) -> Kernel:
    return Kernel(np.arange(count, dtype=np.int32)[:, None], np.ones((count, 1), np.float32))


@pytest.mark.parametrize(
    "sizes",
    [[[1] * 4, [1] * 4], [[5] * 4, [40] * 4], [[1, 5, 33, 70], [3, 40, 64, 66]], [[70] * 4, [3] * 4]],
    ids=["one", "few", "growing", "many"],
)
def test_steps_are_those_of_numpy(sizes: list[list[int]]) -> None:
    """Three of them, with rows and columns in turn, of tables that fill no register; what cannot be reached is dear."""
    rng, counts = np.random.default_rng(2), np.array(sizes)
    kernels = [[some_kernel(rng, *counts[i, step - 1 : step + 1]) for step in (1, 2, 3)] for i in (0, 1)]
    earned = rng.normal(scale=3.0, size=counts[:, -1]).astype(np.float32)
    earned[counts[0, -2] :] = earned[:, counts[1, -2] :] = 500.0
    first, second = counts[:, -1]
    pairs, turned = earned[strip_indices(first, second)], earned.T[strip_indices(second, first)]
    problem = PairProblem(lambda i, step: kernels[i][step - 1], counts, pairs, turned, 0.9)
    backups = CompiledBackup(problem), NumpyBackup(problem)
    exact = np.zeros(counts[:, -1])
    for step in (3, 2, 1):
        now = [kernels[i][step - 1] for i in (0, 1)]
        rows, columns = now if problem.swapped(step) else now[::-1]
        dense = [np.zeros(counts[i, step - 1 : step + 1]) for i in (0, 1)]
        for matrix, (nodes, chances) in zip(dense, now, strict=True):
            np.add.at(matrix, (np.arange(len(nodes))[:, None], nodes), chances)
        some = np.ix_(*(np.arange(n) for n in counts[:, step - 1]))
        exact = earned[some] + np.log(dense[0] @ np.exp(0.9 * exact) @ dense[1].T)
        for backup in backups:
            codes = np.empty(problem.shape(step), np.uint16)
            top = backup.step(rows, columns, turned if problem.swapped(step) else pairs, codes)
            values = Table(codes, top, problem.swapped(step)).values(*some)
            np.testing.assert_allclose(values, exact, rtol=0, atol=0.0015)


def some_kernel(rng: np.random.Generator, count: int, after: int) -> Kernel:
    nodes, chances = rng.integers(after, size=(count, 4)), rng.dirichlet(np.ones(4), count)
    return Kernel(nodes.astype(np.int32), chances.astype(np.float32))
