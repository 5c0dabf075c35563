"""ME-greedy: maximum-likelihood constraint inference of Scobee and Sastry (ICLR 2020), online.

The true reward is given, and that the task is done by the deadline. The demonstrations are modelled by the
maximum-entropy distribution over trajectories that break none of the hard constraints C learned so far,

    P(zeta | C) proportional to exp( sum_t r(s_t, a_t) ) [ zeta breaks no constraint of C ].

Adding constraint k divides the likelihood of demonstrations that respect it by 1 - m_k, m_k = P(zeta breaks k | C).
So each iteration adds the one of largest mass m_k among those that no demonstration has broken, and stops where that
mass is below ``least_mass``: the demonstrations would gain less than -log(1 - least_mass) nats each. A constraint
that a newer demonstration breaks is withdrawn.
"""

from dataclasses import dataclass

import numpy as np

from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Indices, Mask, Vector
from mabirds_core.baselines.interface import CentralState
from mabirds_core.games.interface import TabularGame, Trajectories, discounted_visitation
from mabirds_core.planners.interface import TabularPolicy
from mabirds_core.planners.soft_bellman import SoftBellmanPolicy, maximum_entropy_policy


@dataclass(frozen=True)
class MeGreedy:
    """Constraints are cost features; omega is -1 where one is learned and 0 elsewhere. theta is empty."""

    game: TabularGame
    least_mass: float

    def initial_state(self) -> CentralState:
        """The state before the first demonstration: no constraint is inferred yet."""
        return CentralState(1, Parameters(np.zeros(0), np.zeros(len(self.game.cost_features.names))), ())

    def update(self, state: CentralState, demonstrations: Trajectories) -> CentralState:
        """Withdraw what the demonstrations break, then add at most one constraint."""
        seen = (demonstrations, *state.memory)
        broken = broken_features(self.game, stacked(seen))
        learned = (state.parameters.omega < 0) & ~broken
        policy = self._policy(learned)
        masses = np.where(learned | broken, 0.0, violation_probabilities(self.game, policy))
        best = int(masses.argmax())
        if masses[best] >= self.least_mass:
            learned[best] = True
        parameters = Parameters(state.parameters.theta, -learned.astype(np.float64))
        return CentralState(state.iteration + 1, parameters, seen, policy=policy, work=state.work.more(0, 1))

    def policy(self, parameters: Parameters) -> TabularPolicy:
        """The maximum-entropy policy that breaks no learned constraint."""
        return self._policy(parameters.omega < 0)

    def _policy(self, learned: Mask) -> SoftBellmanPolicy:
        forbidden = self.game.cost_features.table(learned.astype(np.float64)) > 0
        return maximum_entropy_policy(self.game, forbidden)


def broken_features(game: TabularGame, demonstrations: Trajectories) -> Mask:
    """Which cost features demonstrations touch.

    Parameters
    ----------
    game : TabularGame
        With the cost features.
    demonstrations : Trajectories
        At least one.

    Returns
    -------
    Mask
        Shape (K,).
    """
    return game.cost_features.total(discounted_visitation(demonstrations, game.discount)) > 0


def violation_probabilities(game: TabularGame, policy: TabularPolicy) -> Vector:
    """P(phi_k(s_t, a_t) > 0 at some step t = 0..T) for every cost feature k.

    Parameters
    ----------
    game : TabularGame
        With the cost features.
    policy : TabularPolicy
        pi_t(a | s).

    Returns
    -------
    Vector
        Shape (K,).
    """
    states, size = reached_states(game, policy), len(game.cost_features.names)
    places = np.zeros(game.n_states, dtype=np.int64)  # anywhere for states that are not reached: their chances are 0
    places[states] = np.arange(len(states))
    after = places[game.successor[states]]
    respected = [game.cost_features.table(unit)[states] == 0 for unit in np.eye(size)]
    clean = np.ones((size, len(states)))
    for step in range(game.horizon, -1, -1):
        chances = np.exp(policy.log_probabilities(step, states))
        for k, allowed in enumerate(respected):
            clean[k] = (chances * allowed * clean[k][after]).sum(axis=1)
    return np.asarray(1.0 - clean @ game.initial_distribution[states])


def reached_states(game: TabularGame, policy: TabularPolicy) -> Indices:
    """Joint states that a policy can reach from P_0, at any step.

    Parameters
    ----------
    game : TabularGame
        With P_0.
    policy : TabularPolicy
        pi_t(a | s).

    Returns
    -------
    Indices
        In rising order, shape (R,).
    """
    present = reached = game.initial_distribution > 0
    for step in range(game.horizon):
        states = np.flatnonzero(present)
        taken = np.isfinite(policy.log_probabilities(step, states))
        present = np.zeros(game.n_states, dtype=bool)
        present[game.successor[states][taken]] = True
        reached = reached | present
    return np.flatnonzero(reached)
