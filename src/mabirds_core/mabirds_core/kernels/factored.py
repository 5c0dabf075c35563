"""The two passes over games of independent experts in C (``factored.h``), called through ctypes."""

import ctypes
from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Array, Indices, Mask, Vector
from mabirds_core.games.factored import FactoredReward, Factors
from mabirds_core.kernels.loading import library, pointer
from mabirds_core.recent import Recent

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


class _Dynamics:
    """Factors as C sees them; keeps the arrays alive."""

    def __init__(self, factors: Factors) -> None:
        if factors.n_experts > MOST_EXPERTS or factors.n_moves > MOST_MOVES:
            raise ValueError(
                f"{factors.n_experts} experts with {factors.n_moves} moves: the kernels have room for {MOST_EXPERTS}"
                f" with {MOST_MOVES}; set MABIRDS_KERNELS=off"
            )
        offset, offset_of = factors.offsets
        arrays = (
            *(factors.successor, offset, offset_of, factors.coupled_states, factors.coupled_levels),
            *factors.ways,
        )
        kinds = dict(_ARRAYS[: len(arrays)])
        self._arrays = [np.ascontiguousarray(array, kind) for array, kind in zip(arrays, kinds.values(), strict=True)]
        places = [pointer(array, kind) for array, kind in zip(self._arrays, kinds.values(), strict=True)]
        experts, cells, moves = factors.successor.shape
        sizes = {"experts": experts, "cells": cells, "moves": moves, "states": factors.n_states}
        sizes |= {"offsets": len(offset), "coupled": len(factors.coupled_levels), "ways": len(factors.ways.levels)}
        self._game = _Game(**sizes, **dict(zip(kinds, places, strict=True)))

    def with_reward(self, reward: FactoredReward, horizon: int, discount: float) -> _Game:
        """The game that C solves; the reward's arrays must live as long."""
        game = _Game.from_buffer_copy(self._game)
        game.horizon, game.discount, game.levels = horizon, discount, len(reward.levels)
        game.move_weights, game.state_weights, game.level_weights = map(pointer, reward)
        return game


_DYNAMICS = Recent[_Dynamics](4)
"""Of the games that are solved again and again."""


class Solved:
    """A solved game: what the backward pass found, and where a policy that follows it goes. C sees its arrays.

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
    """

    def __init__(self, factors: Factors, reward: FactoredReward, horizon: int, discount: float) -> None:
        self._reward = FactoredReward(*(np.ascontiguousarray(part, np.float64) for part in reward))
        self._dynamics = _DYNAMICS.get(factors, lambda: _Dynamics(factors))
        self._game = self._dynamics.with_reward(self._reward, horizon, discount)
        self._place = ctypes.byref(self._game)
        self._solution = _room(factors, horizon)
        self._places = [pointer(array) for array in (*self._solution[:3], self._solution.onward[factors.n_cells :])]
        self._places.append(pointer(self._solution.shift))
        _call("mabirds_factored_backward", self._place, *self._places)

    @property
    def solution(self) -> Solution:
        """Values and the factors that the forward pass uses."""
        return self._solution

    def forward(self, start: Vector) -> Totals:
        """Follow the policy.

        Parameters
        ----------
        start : Vector
            P_0, shape (S,).

        Returns
        -------
        Totals
            Sums.
        """
        sums = Totals(*(np.zeros(part.shape) for part in self._reward))
        place = ctypes.byref(_Parts(*map(pointer, sums)))
        _call("mabirds_factored_forward", self._place, *self._places, pointer(start), place)
        return sums

    def remaining(self, start: Vector, kept: Totals) -> float:
        """Follow the policy as far as it touches nothing that it may not.

        Parameters
        ----------
        start : Vector
            P_0, shape (S,).
        kept : Totals
            1 for what may be touched, 0 for what may not: probability that does is lost.

        Returns
        -------
        float
            The probability that is left after step T.
        """
        mass, place = ctypes.c_double(), ctypes.byref(_Parts(*map(pointer, kept)))
        _call("mabirds_factored_remaining", self._place, *self._places, pointer(start), place, ctypes.byref(mass))
        return mass.value

    def log_likelihoods(self, states: Indices, actions: Indices, goal: Mask) -> Vector:
        """How probable trajectories are while they are under way.

        Parameters
        ----------
        states : Indices
            Joint states, shape (m, T + 1).
        actions : Indices
            Joint actions, of the same shape.
        goal : Mask
            Where the way has ended, shape (S,).

        Returns
        -------
        Vector
            Sums of log pi_t(a | s), shape (m,).

        Raises
        ------
        ValueError
            They have another number of steps.
        """
        sums, steps = np.empty(len(states)), len(self.solution.chances)
        if states.shape[1] != steps:
            raise ValueError(f"{states.shape[1]} steps, expected {steps}")
        taken = [np.ascontiguousarray(part, np.int64) for part in (states, actions)]
        places = [pointer(goal, np.bool_), *(pointer(part, np.int64) for part in taken)]
        alone, _, gain, *_ = self._places
        size = ctypes.c_int64(len(sums))
        _call("mabirds_factored_likelihood", self._place, alone, gain, *places, size, pointer(sums))
        return sums


def _room(factors: Factors, horizon: int) -> Solution:
    """For what the backward pass finds."""
    cells, states, padding = factors.successor.shape[:2], factors.n_states, factors.n_cells
    onward = np.empty((horizon + 2) * states + 2 * padding)
    onward[:padding] = onward[-padding:] = 0.0
    return Solution(
        np.empty((horizon + 2, *cells)),
        np.empty((horizon + 1, *factors.successor.shape)),
        np.empty((horizon + 2, states)),
        onward,
        np.empty(horizon + 2),
    )


def _call(name: str, *arguments: object) -> None:
    kernels = library()
    if kernels is None:
        raise RuntimeError(f"{name}: the kernels are not compiled, or switched off")
    if getattr(kernels, name)(*arguments):
        raise MemoryError(name)
