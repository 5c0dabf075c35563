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
  the states that episodes meet, and of no others.
- What was seen in a state is replayed at every step: neither the dynamics nor r depend on t.
- An unvisited s' is worth as much as the best visited state among s and its successors. That is optimistic, so
  episodes go and look; and it moves with the reward: adding a constant to r changes no policy. A fixed value, such
  as that of maximum entropy without reward, is far too high for some theta and omega and far too low for others.

So this is soft value iteration on the part of the game seen so far (compare real-time dynamic programming: Barto,
Bradtke and Singh, 1995), and exact in the states from which only visited ones can be reached. A search that starts
from an earlier policy takes over which states were visited and values them anew for its own theta and omega.

Memory: T + 2 values per visited state, and nothing of size T S. The dynamics and the values are not enumerated. The
reward is: reward models and features give whole tables (S, A), asked for once per search.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mabirds_core.arithmetic import exp, log
from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.errors import CheckpointError
from mabirds_core.games.interface import TabularFeatureMap, TabularGame, Trajectories
from mabirds_core.planners.interface import Policy, TabularPolicy
from mabirds_core.planners.occupancy import rollouts
from mabirds_core.planners.soft_bellman import log_sum_exp
from mabirds_core.rewards.models import TabularRewardModel


@dataclass(frozen=True)
class SoftQPolicy:
    """The policy, kept as the values of the N states visited so far.

    Where a state was never visited it looks one step ahead all the same: actions are weighed by their reward and by
    the values of the successors, and by the reward alone where none of these was visited.
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
class SoftQPlanner:
    """The planner that learns from episodes. One that starts from ``previous`` remembers what that one visited."""

    game: TabularGame
    reward_model: TabularRewardModel
    cost_features: TabularFeatureMap
    episodes: int
    """Episodes per sweep."""
    sweeps: int
    """Sweeps per search, each with the newest policy."""
    exploration: float
    """Share of the actions that are drawn uniformly, in [0, 1]; the larger the rewards, the more is needed."""

    def plan(
        self,
        theta: Vector,
        omega: Vector,
        previous: Policy | None = None,
        rng: np.random.Generator | None = None,
        observed: Trajectories | None = None,  # noqa: ARG002 - episodes suffice
    ) -> SoftQPolicy:
        """An estimate of pi(omega, theta), decided by the first four arguments alone.

        It begins anew where ``previous`` is None, of another kind or of another game.

        Raises
        ------
        TypeError
            ``rng`` is None.
        """
        if rng is None:
            raise TypeError("soft Q-learning draws episodes, but rng is None; pass a numpy.random.Generator")
        reward = self.reward_model.table(theta) + self.cost_features.table(omega)
        policy = backed_up(self.game, reward, self._known(previous))
        for _ in range(self.sweeps):
            episodes = rollouts(self.game, ExploringPolicy(policy, self.exploration), self.episodes, rng)
            policy = backed_up(self.game, reward, np.union1d(policy.visited, episodes.states))
        return policy

    def state_dict(self, policy: Policy) -> dict[str, Array]:
        """The visited states; a search values them anew."""
        return {"visited": self._known(policy)[:-1].astype(np.float64)}

    def load_state_dict(self, memory: Mapping[str, Array]) -> SoftQPolicy:
        """A policy that knows the visited states and no reward yet.

        Raises
        ------
        CheckpointError
            They are no states of the game.
        """
        visited = memory.get("visited", np.empty(0))
        states = np.append(visited, self.game.n_states).astype(np.int64)
        if visited.ndim != 1 or (states[:-1] != visited).any() or (np.diff(states) <= 0).any() or states[0] < 0:
            raise CheckpointError(f"visited states: expected rising numbers of states below {self.game.n_states}")
        return backed_up(self.game, np.zeros(self.game.successor.shape), states)

    def _known(self, previous: Policy | None) -> Indices:
        """What ``SoftQPolicy.visited`` is to begin with."""
        if isinstance(previous, SoftQPolicy) and previous.game.digest == self.game.digest:
            return previous.visited
        return np.array([self.game.n_states])


@dataclass(frozen=True)
class ExploringPolicy:
    """``policy`` with a share of its actions drawn uniformly instead."""

    policy: TabularPolicy
    share: float

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """log ( (1 - share) pi_t(a | s) + share / A ), shape (M, A)."""
        chances = exp(self.policy.log_probabilities(step, states))
        return log((1 - self.share) * chances + self.share / chances.shape[1])  # -inf where it is too small


def backed_up(game: TabularGame, reward: Array, visited: Indices) -> SoftQPolicy:
    """One backup of every action of every visited state at every step, backwards in time.

    Parameters
    ----------
    game : TabularGame
        With discount gamma and successors.
    reward : Array
        r(s, a), shape (S, A).
    visited : Indices
        As of ``SoftQPolicy``, shape (N + 1,).

    Returns
    -------
    SoftQPolicy
        With these values.
    """
    values = np.zeros((game.horizon + 2, len(visited)))
    values[:, -1] = -np.inf
    rewards, places = reward[visited[:-1]], successor_places(game, visited[:-1], visited)
    for step in range(game.horizon, -1, -1):
        q = rewards + game.discount * successor_values(values[step + 1], places)
        values[step, :-1] = log_sum_exp(q)
    return SoftQPolicy(game, reward, visited, values)


def successor_places(game: TabularGame, states: Indices, visited: Indices) -> Indices:
    """Where in ``visited`` the A successors of M states and the states themselves are.

    Parameters
    ----------
    game : TabularGame
        With the successors.
    states : Indices
        Joint states, shape (M,).
    visited : Indices
        As of ``SoftQPolicy``, shape (N + 1,).

    Returns
    -------
    Indices
        Shape (M, A + 1); N for those that are not visited.
    """
    nearby = np.column_stack([game.successor[states], states])
    places = np.searchsorted(visited, nearby)
    return np.where(visited[places] == nearby, places, len(visited) - 1)


def successor_values(values: Vector, places: Indices) -> Array:
    """V(s') of the A successors.

    Parameters
    ----------
    values : Vector
        V at ``visited``, shape (N + 1,).
    places : Indices
        As of ``successor_places``, shape (M, A + 1).

    Returns
    -------
    Array
        Shape (M, A); for unvisited ones the row's largest, or 0 if none is visited.
    """
    successors = values[places]
    best = successors.max(axis=1, keepdims=True)
    best[np.isneginf(best)] = 0.0
    return np.where(np.isneginf(successors), best, successors)[:, :-1]
