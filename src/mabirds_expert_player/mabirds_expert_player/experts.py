"""Experts that act optimally under hard constraints, with random choices among equally good joint actions.

Backwards in time, over actions that break no constraint and lead to a state from which none need be broken:

    V_t(s) = max_a task_reward(s, a) + V_{t+1}(successor[s, a]),   V_T = -inf away from the goal

so that at step T every expert has arrived, in the least total time.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mabirds_core.arrays import Array, Indices
from mabirds_core.errors import InfeasibleError
from mabirds_core.games.interface import TabularGame, Trajectories
from mabirds_core.policies.occupancy import rollouts

TIE = 1e-9
"""Joint actions whose values differ by less than this are equally good."""


@dataclass(frozen=True)
class OptimalExperts:
    """The uniform mixture of all optimal joint policies of a tabular game."""

    game: TabularGame

    @cached_property
    def values(self) -> Array:
        """V[t, s], shape (T + 2, S); -inf where no clean way to the goal is left."""
        game = self.game
        values = np.full((game.horizon + 2, game.n_states), -np.inf)
        values[-1] = 0.0
        for step in range(game.horizon, -1, -1):
            values[step] = self._q(values[step + 1], np.arange(game.n_states)).max(axis=1)
            if step == game.horizon:
                values[step, ~game.goal] = -np.inf
        return values

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """Uniform over the best joint actions of each state, shape (M, A); -inf for all others."""
        q = self._q(self.values[step + 1], states)
        best = (q >= self.values[step][states][:, None] - TIE) & np.isfinite(q)
        count = np.maximum(best.sum(axis=1, keepdims=True), 1)
        return np.where(best, -np.log(count), -np.inf)

    def _q(self, next_values: NDArray[np.float64], states: Indices) -> Array:
        game = self.game
        q = game.task_reward[states] + next_values[game.successor[states]]
        return np.where(game.violation[states], -np.inf, q)

    def demonstrations(self, count: int, rng: np.random.Generator) -> Iterator[Trajectories]:
        """``count`` demonstrations from P_0. Raises InfeasibleError where a start has no clean way to the goal."""
        starts = np.flatnonzero(self.game.initial_distribution)
        hopeless = starts[np.isneginf(self.values[0][starts])]
        if len(hopeless):
            raise InfeasibleError(
                f"{len(hopeless)} of {len(starts)} starts have no way to the goal within {self.game.horizon} steps"
                " that breaks no constraint; change the starts, the map or the horizon"
            )
        for _ in range(count):
            yield rollouts(self.game, self, 1, rng)
