"""The constrained soft Bellman policy of experts who move independently of each other (``games/factored``).

With phi_i the soft value of expert i alone, p_i its policy, and the gain G = V - sum_i phi_i,

    G_t(s) = D(s) + log sum_a prod_i p_i(m_i | c_i) exp( W[level(s, a)] + gamma G_{t+1}(s') ),

where the sum is taken one expert after the other: N_E M additions a state in place of M^N_E. Expectations go the same
way forwards and use the factors that the backward pass found. The kernels (``kernels/factored.h``) say how; this is
``soft_bellman`` to 1e-13, which remains the reference.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mabirds_core.arithmetic import exp, powers
from mabirds_core.arrays import Array, Indices, Vector, weighted_counts
from mabirds_core.games.factored import FactoredGame, FactoredReward
from mabirds_core.games.interface import Steps, Trajectories, Visitation
from mabirds_core.kernels.factored import Solution, Solved, Totals
from mabirds_core.kernels.loading import library


class FactoredVisitation(Visitation):
    """A visitation whose totals are known by expert. Pair by pair it is written out where somebody asks for that."""

    totals: Totals
    _pairs: Callable[[], Visitation]

    @staticmethod
    def of(totals: Totals, pairs: Callable[[], Visitation]) -> "FactoredVisitation":
        """Build one.

        Parameters
        ----------
        totals : Totals
            By expert.
        pairs : Callable[[], Visitation]
            Writes it out.

        Returns
        -------
        FactoredVisitation
            Not written out yet.
        """
        visitation = FactoredVisitation(*(np.zeros(0) for _ in Visitation._fields))
        visitation.totals, visitation._pairs = totals, pairs
        return visitation

    @cached_property
    def _written_out(self) -> Visitation:
        return self._pairs()

    @property
    def states(self) -> Steps:
        """Joint states, shape (M,)."""
        return self._written_out.states

    @property
    def actions(self) -> Steps:
        """Joint actions, shape (M,)."""
        return self._written_out.actions

    @property
    def weights(self) -> Vector:
        """Shape (M,)."""
        return self._written_out.weights

    def __iter__(self) -> Iterator[Any]:
        return iter(self._written_out)

    def __getitem__(self, index: Any) -> Any:
        return self._written_out[index]


@dataclass(frozen=True)
class FactoredPolicy:
    """The policy, kept as the gains and what they were found with.

    Attributes
    ----------
    game : FactoredGame
        With its factors.
    reward : FactoredReward
        r_theta + omega^T phi.
    solved : Solved
        By the backward pass.
    """

    game: FactoredGame
    reward: FactoredReward
    solved: Solved

    @property
    def solution(self) -> Solution:
        """What the backward pass found."""
        return self.solved.solution

    @property
    def values(self) -> Array:
        """V[t, s], shape (T + 2, S)."""
        values = self.solution.gain.copy()
        cells = self.game.factors.cells(np.arange(self.game.n_states))
        for expert, own_cells in enumerate(cells):
            values += self.solution.alone[:, expert][:, own_cells]
        return values

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """log pi_t(a | s), shape (M, A)."""
        game, factors, gain = self.game, self.game.factors, self.solution.gain
        ahead = game.discount * gain[step + 1][self._after(states)]
        logs = ahead + self.reward.levels[factors.levels(states)]
        logs += (self.reward.states[states] - gain[step][states])[:, None]
        moves = factors.moves(np.arange(logs.shape[1]))
        for of_expert, own_cells, own_moves in zip(self._alone(step), factors.cells(states), moves, strict=True):
            logs += of_expert[own_cells[:, None], own_moves]
        return np.asarray(logs)

    def log_likelihoods(self, trajectories: Trajectories) -> Vector:
        """Sums of log pi_t(a | s) while trajectories are under way, to the last bit as step by step.

        Parameters
        ----------
        trajectories : Trajectories
            m of them.

        Returns
        -------
        Vector
            Shape (m,).
        """
        return self.solved.log_likelihoods(*trajectories, self.game.goal)

    def _alone(self, step: int) -> Array:
        """log p_i(m | c) of each expert alone, shape (N_E, n, M)."""
        here, after = self.solution.alone[step : step + 2]
        experts = np.arange(len(here))[:, None, None]
        worth = self.game.discount * after[experts, self.game.factors.successor]
        return np.asarray(self.reward.moves + worth - here[:, :, None])

    def _after(self, states: Indices) -> Indices:
        """The joint states after every joint action, shape (M, A)."""
        return self.game.factors.after(states[:, None], np.arange(self.game.n_actions))

    def visitation(self, start: Vector) -> Visitation:
        """Where the policy goes.

        Parameters
        ----------
        start : Vector
            Probabilities of the starts, shape (S,).

        Returns
        -------
        Visitation
            Its weights are gamma^t times probabilities, t = 0..T.
        """
        totals = self.solved.forward(start)
        return FactoredVisitation.of(totals, lambda: self._pairs(start))

    def _pairs(self, start: Vector) -> Visitation:
        game, present = self.game, start
        everywhere, counts = np.arange(game.n_states), np.zeros((game.n_states, game.n_actions))
        after = self._after(everywhere)
        for step, weight in enumerate(powers(game.discount, game.horizon + 1)):
            pairs = present[:, None] * exp(self.log_probabilities(step, everywhere))
            counts += weight * pairs
            present = weighted_counts(after, pairs, game.n_states)
        states, actions = np.nonzero(counts)
        return Visitation(states, actions, counts[states, actions])

    def remaining(self, kept: Totals) -> float:
        """Probability that a trajectory from P_0 touches only what is ``kept`` (1; what is not: 0)."""
        return self.solved.remaining(self.game.initial_distribution, kept)


def factored_policy(game: FactoredGame, reward: FactoredReward) -> FactoredPolicy:
    """The policy of a reward.

    Parameters
    ----------
    game : FactoredGame
        With discount gamma.
    reward : FactoredReward
        r_theta + omega^T phi, finite.

    Returns
    -------
    FactoredPolicy
        pi_t(a | s).
    """
    return FactoredPolicy(game, reward, Solved(game.factors, reward, game.horizon, game.discount))


def factored_reward(reward_model: Any, cost_features: Any, theta: Vector, omega: Vector) -> FactoredReward | None:
    """r_theta + omega^T phi by expert; None where the reward or the costs do not factorise, or nothing is compiled.

    Parameters
    ----------
    reward_model : Any
        r_theta: factorises if ``weights(theta)`` says what it weighs its ``features`` with, and these do.
    cost_features : Any
        phi, or another model of costs: factorise if they say how.
    theta : Vector
        Reward parameters, shape (K_theta,).
    omega : Vector
        Cost weights, shape (K_omega,).

    Returns
    -------
    FactoredReward or None
        The sum.
    """
    features: Any = getattr(reward_model, "features", None)
    if library() is None or not (hasattr(features, "factored") and hasattr(cost_features, "factored")):
        return None
    of_costs: FactoredReward | None = cost_features.factored(omega)
    if of_costs is None or not hasattr(reward_model, "weights"):
        return None
    of_reward: FactoredReward = features.factored(reward_model.weights(theta))
    return of_reward.plus(of_costs)
