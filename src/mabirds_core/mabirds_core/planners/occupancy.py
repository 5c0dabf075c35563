"""Following a policy: rollouts, the exact occupancy measure, and the two ways to an expectation."""

from dataclasses import dataclass

import numpy as np

from mabirds_core.arithmetic import exp, powers
from mabirds_core.arrays import Array, Indices, Vector, weighted_counts
from mabirds_core.errors import InfeasibleError
from mabirds_core.games.interface import TabularGame, Trajectories, Visitation, discounted_visitation
from mabirds_core.planners.factored import FactoredPolicy
from mabirds_core.planners.interface import TabularPolicy

BLOCKED = "the policy leads to a state in which every action is blocked; loosen the hard constraints or the starts"


def start_distribution(game: TabularGame, starts: Indices | None) -> Vector:
    """Where trajectories start.

    Parameters
    ----------
    game : TabularGame
        With P_0.
    starts : Indices or None
        Joint states, each equally likely; None: P_0.

    Returns
    -------
    Vector
        Probabilities, shape (S,).
    """
    if starts is None:
        return game.initial_distribution
    return weighted_counts(starts, np.full(len(starts), 1 / len(starts)), game.n_states)


def rollouts(
    game: TabularGame, policy: TabularPolicy, count: int, rng: np.random.Generator, starts: Indices | None = None
) -> Trajectories:
    """Follow a policy.

    Parameters
    ----------
    game : TabularGame
        Whose dynamics lead on.
    policy : TabularPolicy
        pi_t(a | s).
    count : int
        m: how many trajectories.
    rng : np.random.Generator
        Of starts and actions.
    starts : Indices, optional
        Joint states, each equally likely; default: P_0.

    Returns
    -------
    Trajectories
        m of them.

    Raises
    ------
    InfeasibleError
        The policy has no action to take.
    """
    states = np.empty((count, game.horizon + 1), dtype=np.int64)
    actions = np.empty_like(states)
    current = rng.choice(game.n_states, size=count, p=start_distribution(game, starts))
    for step in range(game.horizon + 1):
        states[:, step] = current
        actions[:, step] = _draw(policy.log_probabilities(step, current), rng)
        current = game.transitions.draw(current, actions[:, step], rng)
    return Trajectories(states, actions)


def _draw(log_probabilities: Array, rng: np.random.Generator) -> Indices:
    """One action per row, by inverting the cumulative distribution."""
    cumulative = exp(log_probabilities).cumsum(axis=1)
    total = cumulative[:, -1:]
    if not (total > 0).all():
        raise InfeasibleError(BLOCKED)
    return np.asarray((cumulative <= rng.random((len(total), 1)) * total).sum(axis=1))


def occupancy_measure(game: TabularGame, policy: TabularPolicy, starts: Indices | None = None) -> Array:
    """rho(s, a) = sum_t gamma^t P(s_t = s, a_t = a) / sum_t gamma^t.

    Parameters
    ----------
    game : TabularGame
        With discount gamma and steps t = 0..T.
    policy : TabularPolicy
        pi_t(a | s).
    starts : Indices, optional
        Joint states, each equally likely; default: P_0.

    Returns
    -------
    Array
        Shape (S, A), of mass 1.
    """
    everywhere = np.arange(game.n_states)
    present = start_distribution(game, starts)
    occupancy = np.zeros((game.n_states, game.n_actions))
    for step, weight in enumerate(powers(game.discount, game.horizon + 1)):
        pairs = present[:, None] * exp(policy.log_probabilities(step, everywhere))
        occupancy += weight * pairs
        present = game.transitions.onward(pairs, slice(None))
    return occupancy / discounted_steps(game)


def discounted_steps(game: TabularGame) -> float:
    """sum_{t=0}^T gamma^t: what turns the occupancy measure into expected discounted sums."""
    return float(powers(game.discount, game.horizon + 1).sum())


def pairs_of(counts: Array) -> Visitation:
    """The pairs of positive count, ``counts`` of shape (S, A), as a visitation: for totals of features."""
    states, actions = np.nonzero(counts)
    return Visitation(states, actions, counts[states, actions])


@dataclass(frozen=True)
class SampledOccupancy:
    """Means over ``count`` rollouts: the paper's m trajectories zeta^j."""

    game: TabularGame
    count: int

    def __call__(self, policy: TabularPolicy, rng: np.random.Generator, starts: Indices | None = None) -> Visitation:
        """The rollouts' visitation."""
        return discounted_visitation(rollouts(self.game, policy, self.count, rng, starts), self.game.discount)


@dataclass(frozen=True)
class ExactOccupancy:
    """The limit m -> infinity: the occupancy measure itself."""

    game: TabularGame
    draws = False

    def __call__(
        self,
        policy: TabularPolicy,
        rng: np.random.Generator,  # noqa: ARG002 - nothing is drawn
        starts: Indices | None = None,
    ) -> Visitation:
        """Every pair of positive probability; by expert, where the policy can say it so.

        Raises
        ------
        InfeasibleError
            The policy has no action to take in a state where it leads.
        """
        if isinstance(policy, FactoredPolicy):  # which has actions to take everywhere
            return policy.visitation(start_distribution(self.game, starts))
        occupancy = occupancy_measure(self.game, policy, starts)
        if not np.isclose(occupancy.sum(), 1.0, rtol=0, atol=1e-9):
            raise InfeasibleError(BLOCKED)
        return pairs_of(discounted_steps(self.game) * occupancy)
