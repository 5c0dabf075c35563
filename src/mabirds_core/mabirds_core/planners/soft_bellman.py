"""The constrained soft Bellman policy by exact soft value iteration (paper, section 4).

    Q_t(s, a) = r_theta(s, a) + omega^T phi(s, a) + gamma E[ V_{t+1}(s') | s, a ]
    V_t(s)    = log sum_a exp Q_t(s, a),                                V_{T+1} = 0
    pi_t(a|s) = exp(Q_t(s, a) - V_t(s))

It is the policy of largest discounted causal entropy plus expected reward. The expectation over s' is inside the sum:
experts choose actions, and not what chance makes of them. A reward of -inf is a hard
constraint: the action gets probability 0, and a state all of whose actions are blocked has the value -inf.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from mabirds_core.arithmetic import exp, log
from mabirds_core.arrays import Array, Indices, Mask, Vector
from mabirds_core.games.factored import FactoredGame
from mabirds_core.games.interface import TabularFeatureMap, TabularGame, Trajectories
from mabirds_core.planners.factored import FactoredPolicy, factored_policy, factored_reward
from mabirds_core.planners.interface import Policy
from mabirds_core.rewards.models import TabularRewardModel


@dataclass(frozen=True)
class SoftBellmanPolicy:
    """The policy, kept as rewards and values.

    Attributes
    ----------
    game : TabularGame
        With the transitions.
    reward : Array
        r_theta + omega^T phi, shape (S, A).
    values : Array
        V[t, s], shape (T + 2, S).
    discount : float
        gamma.
    """

    game: TabularGame
    reward: Array
    values: Array
    discount: float

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """log pi_t(a | s) = Q_t(s, a) - V_t(s), shape (M, A); -inf throughout where all actions are blocked."""
        backup = self.discount * self.game.transitions.expected(self.values[step + 1], states)
        value = self.values[step][states][:, None]
        blocked = np.isneginf(value)
        return np.where(blocked, -np.inf, self.reward[states] + backup - np.where(blocked, 0.0, value))


@dataclass(frozen=True)
class SoftBellmanPlanner:
    """The exact planner, for games that can be enumerated."""

    game: TabularGame
    reward_model: TabularRewardModel
    cost_features: TabularFeatureMap
    draws = False

    def plan(
        self,
        theta: Vector,
        omega: Vector,
        previous: Policy | None = None,  # noqa: ARG002 - exact from any start
        rng: np.random.Generator | None = None,  # noqa: ARG002 - nothing is drawn
        observed: Trajectories | None = None,  # noqa: ARG002 - nothing is learned from examples
    ) -> SoftBellmanPolicy | FactoredPolicy:
        """pi(omega, theta): one expert after the other where the game and the rewards allow that."""
        factored = factored_reward(self.reward_model, self.cost_features, theta, omega)
        if factored is not None and self.game.transitions.deterministic:
            return factored_policy(cast("FactoredGame", self.game), factored)
        reward = self.reward_model.table(theta) + self.cost_features.table(omega)
        return soft_bellman_policy(self.game, reward)

    def state_dict(self, policy: Policy) -> dict[str, Array]:  # noqa: ARG002 - exact from any start
        """No arrays: the planner is exact from any start."""
        return {}

    def load_state_dict(self, memory: Mapping[str, Array]) -> None:
        """No policy: the planner needs none to start from."""


def soft_bellman_policy(game: TabularGame, reward: Array) -> SoftBellmanPolicy:
    """The policy of a reward table.

    Parameters
    ----------
    game : TabularGame
        With discount gamma.
    reward : Array
        r_theta + omega^T phi, shape (S, A), finite or -inf.

    Returns
    -------
    SoftBellmanPolicy
        pi_t(a | s).
    """
    return SoftBellmanPolicy(game, reward, soft_value_iteration(game, reward, game.discount), game.discount)


def maximum_entropy_policy(game: TabularGame, forbidden: Mask) -> SoftBellmanPolicy:
    """What experts do who know the task and which pairs may not be.

    Parameters
    ----------
    game : TabularGame
        With task reward and deadline.
    forbidden : Mask
        Pairs, shape (S, A).

    Returns
    -------
    SoftBellmanPolicy
        Trajectories that are at the goal from the game's deadline on and avoid all forbidden pairs, each with a
        probability proportional to exp of its undiscounted task reward. A state without such a way has the value -inf.
    """
    reward = np.where(forbidden, -np.inf, game.task_reward)
    return SoftBellmanPolicy(game, reward, soft_value_iteration(game, reward, 1.0, game.deadline), 1.0)


def soft_value_iteration(
    game: TabularGame, reward: Array, discount: float, deadline: int | None = None, late_cost: float = np.inf
) -> Array:
    """Soft values, backwards in time and in log space.

    Parameters
    ----------
    game : TabularGame
        With horizon T and transitions.
    reward : Array
        Shape (S, A), finite or -inf.
    discount : float
        gamma.
    deadline : int, optional
        Step from which states away from the goal are worth less; None: never.
    late_cost : float, optional
        How much less. Such a state is worth less than its actions, whose chances must be divided by their sum.

    Returns
    -------
    Array
        V[t, s] for t = 0..T + 1, shape (T + 2, S).
    """
    values = np.zeros((game.horizon + 2, game.n_states))
    for step in range(game.horizon, -1, -1):
        values[step] = log_sum_exp(reward + discount * game.transitions.expected(values[step + 1], slice(None)))
        if deadline is not None and step >= deadline:
            values[step, ~game.goal] -= late_cost
    return values


def log_sum_exp(table: Array) -> Vector:
    """log sum_a exp table[s, a], shape (S,), safe for large numbers; -inf for rows of only -inf."""
    largest = table.max(axis=1)
    shift = np.where(np.isneginf(largest), 0.0, largest)
    return np.asarray(shift + log(exp(table - shift[:, None]).sum(axis=1)))  # log 0 = -inf: a blocked row
