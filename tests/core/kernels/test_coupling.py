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


def encoded(values: Float) -> tuple[Float, np.ndarray]:
    """exp of the values, and codes below 0."""
    result, codes = values.astype(np.float32), np.empty(len(values), np.uint16)
    number = ctypes.c_float
    assert LIBRARY is not None
    LIBRARY.mabirds_encode(
        *(pointer(result, np.float32), ctypes.c_int64(len(values))),
        *(number(0.0), number(LEVELS / DEPTH), number(1.0), number(0.0), pointer(codes, np.uint16)),
    )
    return result, codes


def units(values: Float, exact: Float) -> float:
    """Largest error in units in the last place."""
    return float((np.abs(values - exact) / np.spacing(np.abs(exact).astype(np.float32))).max())


@pytest.mark.parametrize("span", [1e-4, 1.0, 86.9])
def test_exp_is_within_two_units(span: float) -> None:
    x = np.random.default_rng(0).uniform(-span, span, 100_000).astype(np.float32)
    assert units(encoded(x)[0], np.exp(x.astype(np.float64))) <= 2


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


@pytest.mark.parametrize("sizes", [(1, 1), (5, 40), (33, 64), (70, 3)])
def test_steps_are_those_of_numpy(sizes: tuple[int, int]) -> None:
    """Three of them, with rows and columns in turn, of tables that fill no register."""
    rng = np.random.default_rng(2)
    kernels = [Kernel(rng.integers(n, size=(n, 4)).astype(np.int32), rng.dirichlet(np.ones(4), n)) for n in sizes]
    kernels = [Kernel(nodes, chances.astype(np.float32)) for nodes, chances in kernels]
    first, second = sizes
    earned = rng.normal(scale=3.0, size=sizes).astype(np.float32)
    pairs, turned = earned[strip_indices(first, second)], earned.T[strip_indices(second, first)]
    problem = PairProblem(lambda i, _: kernels[i], np.tile(np.array(sizes)[:, None], 4), pairs, turned, 0.9)
    backups = CompiledBackup(problem), NumpyBackup(problem)
    exact = np.zeros(sizes)
    for step in range(3):
        rows, columns = kernels if step % 2 == 0 else kernels[::-1]
        assert problem.shape(3 - step) == (strips(len(rows.nodes)), len(columns.nodes), LANES)
        found = [np.empty(problem.shape(3 - step), np.uint16) for _ in range(2)]
        tops = [
            of.step(rows, columns, (turned, pairs)[step % 2], codes) for of, codes in zip(backups, found, strict=True)
        ]
        dense = [np.zeros((n, n)) for n in sizes]
        for matrix, (nodes, chances) in zip(dense, kernels, strict=True):
            np.add.at(matrix, (np.arange(len(nodes))[:, None], nodes), chances)
        exact = earned + np.log(dense[0] @ np.exp(0.9 * exact) @ dense[1].T)
        for top, codes in zip(tops, found, strict=True):
            values = Table(codes, top, swapped=step % 2 == 0).values(*np.ogrid[:first, :second])
            np.testing.assert_allclose(values, exact, rtol=0, atol=0.0015)
