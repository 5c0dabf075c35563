"""What vehicles can cost and be worth: indicators of each vehicle's cell and move, and of meeting in the junction."""

from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Vector, weighted_counts
from mabirds_core.games.interface import Visitation
from mabirds_junction.lanes import Lanes


class JunctionCostFeatures:
    """phi(s, a): an indicator per vehicle and cell, then how many pairs meet in the junction."""

    nonnegative = True

    def __init__(self, lanes: Lanes) -> None:
        self._lanes = lanes
        cells = [f"vehicle_{i + 1} in cell {c}" for i, length in enumerate(lanes.lengths) for c in range(length)]
        self.names = (*cells, "meeting in the junction")

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] phi(states[k], actions[k]), shape (K,)."""
        lanes, (states, _, weights) = self._lanes, visitation
        by_vehicle = zip(lanes.cells(states), lanes.lengths, strict=True)
        counts = [weighted_counts(cells, weights, length) for cells, length in by_vehicle]
        return np.concatenate([*counts, [(weights * lanes.meeting[states]).sum()]])

    def table(self, weights: Vector) -> Array:
        """weights^T phi(s, a), shape (S, A)."""
        lanes = self._lanes
        *by_vehicle, meeting = np.split(weights, np.cumsum(lanes.lengths))
        cells = lanes.cells(np.arange(lanes.n_states))
        of_state = meeting[0] * lanes.meeting + sum(values[c] for values, c in zip(by_vehicle, cells, strict=True))
        return np.repeat(of_state[:, None], lanes.n_actions, axis=1)


class JunctionRewardFeatures:
    """f(s, a): an indicator per vehicle, cell and move, moves varying fastest."""

    nonnegative = True

    def __init__(self, lanes: Lanes) -> None:
        self._lanes = lanes
        self.names = tuple(
            f"vehicle_{i + 1} in cell {c} {move}"
            for i, length in enumerate(lanes.lengths)
            for c in range(length)
            for move in ("waiting", "going")
        )

    @cached_property
    def descriptors(self) -> Array:
        """Which vehicle, which move, and the place on its lane from -1 to 1, shape (K, N_E + 3)."""
        vehicles = self._lanes.n_vehicles
        rows = [
            [*np.eye(vehicles)[i], *np.eye(2)[move], 2 * c / max(1, length - 1) - 1]
            for i, length in enumerate(self._lanes.lengths)
            for c in range(length)
            for move in (0, 1)
        ]
        return np.array(rows)

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] f(states[k], actions[k]), shape (K,)."""
        lanes, (states, actions, weights) = self._lanes, visitation
        pairs = 2 * lanes.cells(states) + lanes.moves(actions)
        by_vehicle = zip(pairs, lanes.lengths, strict=True)
        return np.concatenate(
            [weighted_counts(pairs_of_vehicle, weights, 2 * length) for pairs_of_vehicle, length in by_vehicle]
        )

    def table(self, weights: Vector) -> Array:
        """weights^T f(s, a), shape (S, A)."""
        lanes = self._lanes
        by_vehicle = np.split(weights, np.cumsum([2 * length for length in lanes.lengths])[:-1])
        cells, moves = lanes.cells(np.arange(lanes.n_states)), lanes.moves(np.arange(lanes.n_actions))
        table = np.zeros((lanes.n_states, lanes.n_actions))
        for values, c, m in zip(by_vehicle, cells, moves, strict=True):
            table += values[2 * c[:, None] + m]
        return table
