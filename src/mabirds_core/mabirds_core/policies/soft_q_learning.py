"""The constrained soft Bellman policy by tabular soft Q-learning, for games that are sampled and not enumerated.

    Q_t(s, a) <- r(s, a) + gamma V_{t+1}(s'),   r = r_theta + omega^T phi,   s' = successor[s, a]
    V_t(s)    <- log sum_a exp Q_t(s, a),                                    V_{T+1} = 0
    pi_t(a|s)  = exp(Q_t(s, a) - V_t(s))

These are the backups of G-learning (Fox, Pakman and Tishby, UAI 2016) and of soft Q-learning (Haarnoja, Tang,
Abbeel and Levine, ICML 2017) at temperature 1. Transitions are deterministic, so the step size is 1: a backup is
exact where V_{t+1}(s') is.

A sweep follows the newest policy, mixed with uniform actions, for some episodes from P_0. It adds the states met
to those visited before and backs all of them up, t = T first and 0 last. Three choices make few episodes suffice:

- Every action of a visited state is backed up, not only those taken: the simulator is asked for the successors of
  visited states, and of no others.
- What was seen in a state is replayed at every step: the dynamics and r do not depend on t.
- An unvisited s' is worth as much as the best visited successor of s. That is optimistic, so the episodes go and
  look, and it follows the scale of the reward: adding a constant to r changes no policy. A fixed value, such as
  that of maximum entropy without reward, is far too high for one theta and far too low for another.

So this is soft value iteration on the part of the game seen so far (compare real-time dynamic programming, Barto,
Bradtke and Singh 1995), exact in all states from which only visited states can be reached. Between two searches it
keeps which states were visited, and evaluates them anew under the new theta and omega: stale values cannot survive.

Memory: T + 2 values a visited state, and nothing over all S states but the reward: reward models and features are
asked for their whole table (S, A), once a search. The dynamics and the values are not enumerated.
"""

from dataclasses import dataclass

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.interface import FeatureMap, TabularGame
from mabirds_core.policies.interface import Policy
from mabirds_core.policies.occupancy import rollouts
from mabirds_core.policies.soft_bellman import log_sum_exp
from mabirds_core.rewards import RewardModel


@dataclass(frozen=True)
class SoftQPolicy:
    """The policy, kept as the values of the N states visited so far.

    A state that was never visited is treated like the others, by looking one step ahead: its actions are weighed
    by their reward and the values of its visited successors. Where it has none, the reward alone decides.
    """

    game: TabularGame
    reward: Array
    """r(s, a), finite, shape (S, A)."""
    visited: Indices
    """The visited states in rising order, then S, which stands for all others; shape (N + 1,)."""
    values: Array
    """V_t at ``visited``, -inf for "all others"; shape (T + 2, N + 1)."""

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """log pi_t(a | s), shape (M, A); finite."""
        ahead = successor_values(self.values[step + 1], successor_places(self.game, states, self.visited))
        q = self.reward[states] + self.game.discount * ahead
        q -= q.max(axis=1, keepdims=True)  # before the logarithm of the sum, which large values would swallow
        return np.asarray(q - log_sum_exp(q)[:, None])


@dataclass(frozen=True)
class SoftQFinder:
    """The finder that learns from episodes. One that starts from ``previous`` remembers what that one visited."""

    game: TabularGame
    reward_model: RewardModel
    cost_features: FeatureMap
    episodes: int
    """Episodes a sweep."""
    sweeps: int
    """Sweeps a search, each with the newest policy."""
    exploration: float
    """Share of the actions that are drawn uniformly, in [0, 1]."""

    def find(
        self, theta: Vector, omega: Vector, previous: Policy | None = None, rng: np.random.Generator | None = None
    ) -> SoftQPolicy:
        """An estimate of pi(omega, theta), decided by the four arguments alone.

        It begins anew where ``previous`` is None, of another kind or of another game.
        """
        if rng is None:
            raise TypeError("soft Q-learning draws episodes, but rng is None; pass a numpy.random.Generator")
        reward = self.reward_model.table(theta) + self.cost_features.table(omega)
        policy = backed_up(self.game, reward, self._known(previous))
        for _ in range(self.sweeps):
            episodes = rollouts(self.game, ExploringPolicy(policy, self.exploration), self.episodes, rng)
            policy = backed_up(self.game, reward, np.union1d(policy.visited, episodes.states))
        return policy

    def _known(self, previous: Policy | None) -> Indices:
        """What ``SoftQPolicy.visited`` is to begin with."""
        if isinstance(previous, SoftQPolicy) and previous.game.digest == self.game.digest:
            return previous.visited
        return np.array([self.game.n_states])


@dataclass(frozen=True)
class ExploringPolicy:
    """``policy`` with a share of its actions drawn uniformly instead."""

    policy: Policy
    share: float

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """log ( (1 - share) pi_t(a | s) + share / A ), shape (M, A)."""
        chances = np.exp(self.policy.log_probabilities(step, states))
        with np.errstate(divide="ignore"):  # without exploration a chance may be too small for a number
            return np.asarray(np.log((1 - self.share) * chances + self.share / chances.shape[1]))


def backed_up(game: TabularGame, reward: Array, visited: Indices) -> SoftQPolicy:
    """One backup of every action of every visited state at every step, backwards in time."""
    values = np.zeros((game.horizon + 2, len(visited)))
    values[:, -1] = -np.inf
    own, places = reward[visited[:-1]], successor_places(game, visited[:-1], visited)
    for step in range(game.horizon, -1, -1):
        q = own + game.discount * successor_values(values[step + 1], places)
        values[step, :-1] = log_sum_exp(q)
    return SoftQPolicy(game, reward, visited, values)


def successor_places(game: TabularGame, states: Indices, visited: Indices) -> Indices:
    """Where in ``visited`` the successors of M states are, shape (M, A); the last place for those that are not."""
    successors = game.successor[states]
    places = np.searchsorted(visited, successors)
    return np.where(visited[places] == successors, places, len(visited) - 1)


def successor_values(values: Vector, places: Indices) -> Array:
    """V(s') at ``places``, shape (M, A); an unvisited s' has the largest value of its row, or 0 where all are such."""
    known = values[places]
    best = known.max(axis=1, keepdims=True)
    return np.where(np.isneginf(known), np.where(np.isneginf(best), 0.0, best), known)
