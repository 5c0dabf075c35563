"""The two passes over games of independent experts in C (``factored.h``), called through ctypes."""

import ctypes
from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.factored import FactoredReward, Factors
from mabirds_core.kernels.loading import library, pointer

_INTEGERS = ("experts", "cells", "moves", "states", "horizon", "offsets", "coupled", "ways", "levels")
_ARRAYS = (
    ("successor", np.int32),
    ("offset", np.int32),
    ("offset_of", np.int32),
    ("coupled_states", np.int32),
    ("coupled_levels", np.uint8),
    ("way_levels", np.uint8),
    ("way_of", np.int32),
    ("way_after", np.int32),
    ("way_entries", np.int32),
    ("move_weights", np.float64),
    ("state_weights", np.float64),
    ("level_weights", np.float64),
)
MOST_EXPERTS, MOST_MOVES = 16, 256
"""What the kernels have room for."""


class _Game(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int64) for name in _INTEGERS),
        ("discount", ctypes.c_double),
        *((name, ctypes.c_void_p) for name, _ in _ARRAYS),
    )


class _Parts(ctypes.Structure):
    """Sums, or what is kept: of moves, states and levels."""

    _fields_ = (("moves", ctypes.c_void_p), ("states", ctypes.c_void_p), ("levels", ctypes.c_void_p))


class Solution(NamedTuple):
    """What the backward pass found.

    Attributes
    ----------
    alone : Array
        phi[t, i, c]: the soft value of each expert alone, shape (T + 2, N_E, n).
    chances : Array
        p of its moves, shape (T + 1, N_E, n, M).
    gain : Array
        V_t(s) - sum_i phi_i,t(c_i), shape (T + 2, S).
    onward : Vector
        exp(gamma (gain - shift)), shape (T + 2, S), with n numbers more at both ends.
    shift : Vector
        The largest gain of each step, shape (T + 2,).
    """

    alone: Array
    chances: Array
    gain: Array
    onward: Vector
    shift: Vector


class Totals(NamedTuple):
    """gamma^t-weighted sums of probabilities over t = 0..T.

    Attributes
    ----------
    moves : Array
        Of each expert's moves, shape (N_E, n, M).
    states : Vector
        Of joint states, shape (S,).
    levels : Vector
        Of levels in coupled states, shape (L,).
    """

    moves: Array
    states: Vector
    levels: Vector


class _Arguments:
    """A game and a reward as C sees them; keeps the arrays alive."""

    def __init__(self, factors: Factors, reward: FactoredReward, horizon: int, discount: float) -> None:
        if factors.n_experts > MOST_EXPERTS or factors.n_moves > MOST_MOVES:
            raise ValueError(
                f"{factors.n_experts} experts with {factors.n_moves} moves: the kernels have room for {MOST_EXPERTS}"
                f" with {MOST_MOVES}; set MABIRDS_KERNELS=off"
            )
        offset, offset_of = factors.offsets
        arrays = (
            factors.successor,
            offset,
            offset_of,
            factors.coupled_states,
            factors.coupled_levels,
            *factors.ways,
            *reward,
        )
        self._arrays = [np.ascontiguousarray(array, dtype) for array, (_, dtype) in zip(arrays, _ARRAYS, strict=True)]
        sizes = (*factors.successor.shape, factors.n_states, horizon, len(offset))
        coupled = (*factors.coupled_levels.shape[:1], len(factors.ways.levels), len(reward.levels))
        places = (pointer(array, dtype) for array, (_, dtype) in zip(self._arrays, _ARRAYS, strict=True))
        self.game = _Game(*sizes, *coupled, discount, *places)

    @property
    def reference(self) -> object:
        return ctypes.byref(self.game)


def backward(factors: Factors, reward: FactoredReward, horizon: int, discount: float) -> Solution:
    """Find the soft values.

    Parameters
    ----------
    factors : Factors
        The dynamics.
    reward : FactoredReward
        All finite.
    horizon : int
        T.
    discount : float
        gamma.

    Returns
    -------
    Solution
        Values and the factors that the forward pass uses.
    """
    cells, states = factors.successor.shape[:2], factors.n_states
    onward = np.empty((horizon + 2) * states + 2 * factors.n_cells)
    onward[: factors.n_cells] = onward[-factors.n_cells :] = 0.0
    solution = Solution(
        np.empty((horizon + 2, *cells)),
        np.empty((horizon + 1, *factors.successor.shape)),
        np.empty((horizon + 2, states)),
        onward,
        np.empty(horizon + 2),
    )
    arguments = _Arguments(factors, reward, horizon, discount)
    places = [pointer(array) for array in (*solution[:3], onward[factors.n_cells :], solution.shift)]
    _call("mabirds_factored_backward", arguments.reference, *places)
    return solution


def forward(
    factors: Factors,
    reward: FactoredReward,
    solution: Solution,
    discount: float,
    start: Vector,
    kept: Totals | None = None,
) -> tuple[Totals, float]:
    """Follow the policy.

    Parameters
    ----------
    factors : Factors
        The dynamics.
    reward : FactoredReward
        As of the backward pass.
    solution : Solution
        Of the backward pass.
    discount : float
        gamma.
    start : Vector
        P_0, shape (S,).
    kept : Totals, optional
        1 for what may be touched, 0 for what may not: probability that does is lost. Default: all may.

    Returns
    -------
    tuple[Totals, float]
        Sums, and the probability that is left after step T.
    """
    sums, mass = Totals(*(np.zeros_like(part) for part in reward)), ctypes.c_double()
    arguments = _Arguments(factors, reward, len(solution.chances) - 1, discount)
    arrays = (*solution[:3], solution.onward[factors.n_cells :], solution.shift, start)
    parts = [_Parts(*(pointer(part) for part in each)) if each else None for each in (kept, sums)]
    _call(
        "mabirds_factored_forward",
        arguments.reference,
        *(pointer(array) for array in arrays),
        *(ctypes.byref(part) if part else None for part in parts),
        ctypes.byref(mass),
    )
    return sums, mass.value


def _call(name: str, *arguments: object) -> None:
    kernels = library()
    if kernels is None:
        raise RuntimeError(f"{name}: the kernels are not compiled, or switched off")
    if getattr(kernels, name)(*arguments):
        raise MemoryError(name)
