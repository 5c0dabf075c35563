"""Experts that act under hard constraints and arrive in time: optimally, or with maximum entropy.

Optimal experts take the least total time. Backwards in time, over actions that break no constraint and lead to a
state from which none need be broken:

    V_t(s) = max_a task_reward(s, a) + V_{t+1}(successor[s, a]),   V_t = -inf away from the goal for t >= deadline

Soft experts draw from all clean ways that arrive by the deadline, each with a probability proportional to exp of
its reward; where a step costs nothing, all of them are equally good and equally likely.

Where moves slip nobody can promise either. A step with a violation then costs ``violation_cost``, and so does a step
under way from the deadline on; soft experts follow the causal-entropy policy of that reward.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mabirds_core.arrays import Array, Indices
from mabirds_core.errors import InfeasibleError
from mabirds_core.games.interface import TabularGame, Trajectories
from mabirds_core.planners.occupancy import rollouts
from mabirds_core.planners.soft_bellman import (
    SoftBellmanPolicy,
    log_sum_exp,
    maximum_entropy_policy,
    soft_value_iteration,
)

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
            if step >= game.deadline:
                values[step, ~game.goal] -= game.violation_cost
        return values

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """Uniform over the best joint actions of each state, shape (M, A); -inf for all others."""
        q = self._q(self.values[step + 1], states)
        most = self.values[step][states] if self.game.transitions.deterministic else q.max(axis=1)
        best = (q >= most[:, None] - TIE) & np.isfinite(q)
        count = np.maximum(best.sum(axis=1, keepdims=True), 1)
        return np.where(best, -np.log(count), -np.inf)

    def _q(self, next_values: NDArray[np.float64], states: Indices) -> Array:
        game = self.game
        q = game.task_reward[states] + game.transitions.expected(next_values, states)
        return np.where(game.violation[states], q - game.violation_cost, q)


@dataclass(frozen=True)
class SoftExperts:
    """The maximum-entropy policy of the true reward among those that keep the constraints and the deadline."""

    game: TabularGame

    @cached_property
    def _policy(self) -> SoftBellmanPolicy:
        game = self.game
        if game.transitions.deterministic:
            return maximum_entropy_policy(game, game.violation)
        reward = np.where(game.violation, game.task_reward - game.violation_cost, game.task_reward)
        values = soft_value_iteration(game, reward, 1.0, game.deadline, game.violation_cost)
        return SoftBellmanPolicy(game, reward, values, 1.0)

    @property
    def values(self) -> Array:
        """V[t, s], shape (T + 2, S); -inf where no clean way to the goal is left."""
        return self._policy.values

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """log pi_t(a | s), shape (M, A); -inf throughout where no clean way to the goal is left."""
        logs = self._policy.log_probabilities(step, states)
        if self.game.transitions.deterministic:
            return logs
        return np.asarray(logs - log_sum_exp(logs)[:, None])  # late states are worth less than their actions


TabularExpertPolicy = OptimalExperts | SoftExperts

KINDS: dict[str, type[TabularExpertPolicy]] = {"optimal": OptimalExperts, "soft": SoftExperts}
"""By the name in the experiment file."""


def demonstrations(experts: TabularExpertPolicy, count: int, rng: np.random.Generator) -> Iterator[Trajectories]:
    """Demonstrate from P_0.

    Parameters
    ----------
    experts : TabularExpertPolicy
        Whose policy is followed.
    count : int
        How many demonstrations.
    rng : np.random.Generator
        Of starts and actions.

    Yields
    ------
    Trajectories
        One each.

    Raises
    ------
    InfeasibleError
        A start has no clean way to the goal.
    """
    game = experts.game
    starts = np.flatnonzero(game.initial_distribution)
    hopeless = starts[np.isneginf(experts.values[0][starts])]
    if len(hopeless):
        raise InfeasibleError(
            f"{len(hopeless)} of {len(starts)} starts have no way to the goal within {game.deadline} steps"
            " that breaks no constraint; change the starts, the map, the deadline or the horizon"
        )
    for _ in range(count):
        yield rollouts(game, experts, 1, rng)


@dataclass(frozen=True)
class TabularExperts:
    """Experts who follow one of these policies."""

    policy: TabularExpertPolicy

    def demonstrations(self, count: int, rng: np.random.Generator) -> Iterator[Trajectories]:
        """``count`` demonstrations from P_0, one trajectory each."""
        return demonstrations(self.policy, count, rng)
