"""Which cost features are constraints, with what confidence: a counterfactual test.

A feature that a demonstration had is no constraint: one of any learner's where theta says that (``rewards.shown``),
else of a learner's own. Of any other feature k the question is whether trajectories would have had it if it were as
good as what experts do:

    p_k = P(a trajectory has feature k | the learned reward with k made neutral)
    confidence = 1 - (1 - p_k)^N              for N demonstrations that never had it

It is a constraint at confidence q where the confidence is at least q. Else it is undetermined: so few ways would have
led there anyway that N demonstrations cannot tell. What neutral means is the game's to say (``neutral_change``), by
what the learned policy does, so that learners who agree on theta and omega agree on p_k, whoever saw what.
p_k is a matter of policies alone: parameters that mean the same policies give the same p_k, which -omega does not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, cast

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Mask, Vector, weighted_counts
from mabirds_core.costs.models import costs_of
from mabirds_core.games.factored import FactoredGame, FactoredReward
from mabirds_core.games.interface import ShownFeatures, TabularGame
from mabirds_core.games.tabular.decidable import touch_chance
from mabirds_core.kernels.factored import Totals
from mabirds_core.planners.factored import factored_policy, factored_reward
from mabirds_core.planners.occupancy import discounted_steps, occupancy_measure, pairs_of
from mabirds_core.planners.soft_bellman import soft_bellman_policy
from mabirds_core.rewards.models import TabularRewardModel

SELDOM = 1e-4
"""Discounted visits of the learned policy that do not count: leaks into what it is to avoid. A neutral cell opens ways
through cells where experts go seldom as well; those they are free to use should be as good as they are.
"""

USED = -1.0
"""Confidence of a feature that a demonstration had: it is no constraint."""


class NeutralGame(TabularGame, Protocol):
    """A tabular game that can make a cost feature neutral."""

    def neutral_change(self, rewards: Vector, omega: Vector, expected: Vector, feature: int) -> Parameters | None:
        """What makes cost feature ``feature`` neutral.

        Parameters
        ----------
        rewards : Vector
            Weights of the reward features, shape (K_f,).
        omega : Vector
            Cost weights, shape (K,).
        expected : Vector
            Discounted counts of the reward features under the learned policy, shape (K_f,); 0 where it seldom goes.
        feature : int
            k.

        Returns
        -------
        Parameters or None
            Changes of the reward features' weights and of omega; None where the policy comes not near the feature,
            so that nothing can be said of it.
        """
        ...


def constraint_confidences(
    game: NeutralGame,
    reward: TabularRewardModel,
    parameters: Parameters,
    shown: ShownFeatures,
    known: "KnownChances | None" = None,
) -> Vector:
    """Confidence that each cost feature is a constraint.

    Parameters
    ----------
    game : NeutralGame
        The game.
    reward : TabularRewardModel
        r_theta.
    parameters : Parameters
        theta and omega as learned.
    shown : ShownFeatures
        By at least one demonstration.
    known : KnownChances, optional
        What was found before.

    Returns
    -------
    Vector
        Shape (K,): in [0, 1], or USED.
    """
    learned, omega = _learned(game, reward, parameters), costs_of(game).by_feature(parameters.omega)
    weights = reward.weights(parameters.theta) if hasattr(reward, "weights") else np.zeros(0)
    chances = (known or KnownChances()).of([*learned.numbers, *parameters, weights])
    confidences = np.full(len(shown.used), USED)
    for feature in map(int, np.flatnonzero(~shown.used)):
        if feature not in chances:
            chances[feature] = _touch_chance(game, learned, weights, omega, feature)
        confidences[feature] = 1 - (1 - chances[feature]) ** shown.demonstrations
    return confidences


class KnownChances:
    """p_k that were found for the newest learned reward: learners who agree on it share them."""

    def __init__(self) -> None:
        self._numbers: Sequence[Array] = ()
        self._chances: dict[int, float] = {}

    def of(self, numbers: Sequence[Array]) -> dict[int, float]:
        """By feature, to be added to.

        Parameters
        ----------
        numbers : Sequence
            All that the chances depend on.

        Returns
        -------
        dict[int, float]
            Empty where the numbers are others than the newest.
        """
        same = len(numbers) == len(self._numbers) and all(
            np.array_equal(mine, theirs) for mine, theirs in zip(self._numbers, numbers, strict=True)
        )
        if not same:
            self._numbers, self._chances = numbers, {}
        return self._chances


def _touch_chance(game: NeutralGame, learned: "_Learned", weights: Vector, omega: Vector, feature: int) -> float:
    """p_k of one feature."""
    counts = learned.expected_counts
    expected = np.where(counts >= SELDOM, counts, 0.0)
    change = game.neutral_change(weights if weights.size else np.zeros(len(expected)), omega, expected, feature)
    unit = np.zeros(len(omega))
    unit[feature] = 1.0
    return 0.0 if change is None else learned.touch_probability(change, unit)


class _Learned(Protocol):
    """The learned reward, in one of two forms."""

    @property
    def numbers(self) -> Sequence[Array]:
        """What it is made of."""
        ...

    @property
    def expected_counts(self) -> Vector:
        """E_pi sum gamma^t f of the reward features, shape (K_f,)."""
        ...

    def touch_probability(self, change: Parameters, unit: Vector) -> float:
        """p_k, with ``change`` added to the weights, where ``unit`` is 1 at cost feature k and 0 elsewhere."""
        ...


def _learned(game: NeutralGame, reward: TabularRewardModel, parameters: Parameters) -> _Learned:
    """By expert, where the game and the rewards allow that."""
    costs = costs_of(game)
    factored = factored_reward(reward, costs, *parameters)
    if factored is not None and game.transitions.deterministic:
        return _LearnedByExpert(cast("FactoredGame", game), factored)
    return _LearnedTable(game, reward.table(parameters.theta) + costs.table(parameters.omega))


@dataclass(frozen=True)
class _LearnedByExpert:
    game: FactoredGame
    reward: FactoredReward

    @property
    def numbers(self) -> Sequence[Array]:
        return self.reward

    @cached_property
    def expected_counts(self) -> Vector:
        policy = factored_policy(self.game, self.reward)
        return self.game.reward_features.total(policy.visitation(self.game.initial_distribution))

    def touch_probability(self, change: Parameters, unit: Vector) -> float:
        features: Any = self.game.reward_features
        costs: Any = self.game.cost_features
        neutral = self.reward.plus(features.factored(change.theta)).plus(costs.factored(change.omega))
        kept = Totals(*(np.where(part > 0, 0.0, 1.0) for part in costs.factored(unit)))
        return _chance(factored_policy(self.game, neutral).remaining(kept))


@dataclass(frozen=True)
class _LearnedTable:
    game: TabularGame
    reward: Array

    @property
    def numbers(self) -> Sequence[Array]:
        return (self.reward,)

    @cached_property
    def expected_counts(self) -> Vector:
        occupancy = occupancy_measure(self.game, soft_bellman_policy(self.game, self.reward))
        return self.game.reward_features.total(pairs_of(discounted_steps(self.game) * occupancy))

    def touch_probability(self, change: Parameters, unit: Vector) -> float:
        costs = self.game.cost_features
        neutral = self.reward + self.game.reward_features.table(change.theta) + costs.table(change.omega)
        return touch_probability(self.game, neutral, costs.table(unit) > 0)


def _chance(remaining: float) -> float:
    """Of touching, where ``remaining`` is that of not; rounding may carry it past 0 or 1 by some 1e-15."""
    return min(1.0, max(0.0, 1.0 - remaining))


def touch_probability(game: TabularGame, reward: Array, touched: Mask) -> float:
    """Probability that a trajectory of the soft Bellman policy of ``reward`` has one of the pairs ``touched``.

    Parameters
    ----------
    game : TabularGame
        Trajectories begin in P_0.
    reward : Array
        Reward table, shape (S, A).
    touched : Mask
        Pairs, shape (S, A).

    Returns
    -------
    float
        In [0, 1]. Where nothing slips, the backward pass is that of ``soft_bellman`` with exp of the reward taken once:
        with Y_t(s) = exp(gamma (V_t(s) - max V_t)), pi_t(a|s) is proportional to exp(r(s, a)) Y_{t+1}(s').
        Probabilities below exp(-700) become 0.
    """
    if not game.transitions.deterministic:
        return touch_chance(game, soft_bellman_policy(game, reward), touched)
    factors = np.exp(reward - reward.max())
    steps = game.horizon + 1
    onward = np.ones((steps + 1, game.n_states))
    mass = np.empty((steps, game.n_states))
    for step in reversed(range(steps)):
        mass[step] = (factors * onward[step + 1][game.successor]).sum(axis=1)
        with np.errstate(divide="ignore"):
            values = np.log(mass[step])
        onward[step] = np.exp(game.discount * (values - values.max()))
    untouched, clean = np.where(touched, 0.0, factors), game.initial_distribution
    for step in range(steps):
        states = np.flatnonzero(clean)
        share = clean[states] / np.maximum(mass[step][states], np.finfo(np.float64).tiny)
        pairs = share[:, None] * untouched[states] * onward[step + 1][game.successor[states]]
        clean = weighted_counts(game.successor[states], pairs, game.n_states)
    return _chance(float(clean.sum()))
