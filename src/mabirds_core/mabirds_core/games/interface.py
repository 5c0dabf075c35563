"""What a constrained Markov game offers to learners, experts and metrics (paper, section 2).

A game is (states, actions, transitions, gamma, P_0, reward, cost features, horizon T) of N_E experts that act
together: a state and an action are those of all experts at once. Trajectories have T + 1 steps, t = 0..T.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mabirds_core.arrays import Array, Indices, Mask, Vector

Steps = NDArray[Any]
"""Joint states or actions: an index each in a tabular game, a row of real numbers each in a continuous one."""


class Trajectories(NamedTuple):
    """m joint trajectories; axis 0 counts trajectories, axis 1 the steps t = 0..T.

    ``states``: (m, T + 1) joint state indices in a tabular game, (m, T + 1, D_s) numbers in a continuous one.
    ``actions``: (m, T + 1) joint action indices in a tabular game, (m, T + 1, D_a) numbers in a continuous one.
    """

    states: Steps
    actions: Steps


class Visitation(NamedTuple):
    """A weighted set of M state-action pairs: sum_k weights[k] f(states[k], actions[k]) estimates E sum_t gamma^t f.

    One trajectory, a batch of rollouts and an exact occupancy measure all take this form, so that features and
    reward gradients are summed by one function each. The pairs are rows of axis 0.
    """

    states: Steps
    actions: Steps
    weights: Vector


class FeatureMap(Protocol):
    """Features phi(s, a)."""

    @property
    def names(self) -> tuple[str, ...]:
        """One name per feature, for people, shape (K,)."""
        ...

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] phi(states[k], actions[k]), shape (K,)."""
        ...


class TabularFeatureMap(FeatureMap, Protocol):
    """Features of a tabular game with S joint states and A joint actions."""

    def table(self, weights: Vector) -> Array:
        """weights^T phi(s, a) for every pair, shape (S, A); ``weights`` has shape (K,)."""
        ...


class RewardFeatureMap(TabularFeatureMap, Protocol):
    """Features of a reward; a network can make their weights from what the features mean."""

    @property
    def descriptors(self) -> Array:
        """What tells the features apart, as numbers in [-1, 1], shape (K, D)."""
        ...


class ConstrainedMarkovGame(Protocol):
    """A game as learners and metrics see it."""

    @property
    def digest(self) -> str:
        """SHA-256 of what decides its trajectories: states, actions, dynamics. Bags and messages are bound to it."""
        ...

    @property
    def horizon(self) -> int:
        """T: the last step; trajectories have T + 1 steps."""
        ...

    @property
    def discount(self) -> float:
        """gamma in (0, 1]."""
        ...

    @property
    def n_experts(self) -> int:
        """N_E: how many experts act together."""
        ...

    @property
    def cost_features(self) -> FeatureMap:
        """phi: what omega weighs."""
        ...

    @property
    def true_constraints(self) -> Mask:
        """Which cost features the experts really may not touch, shape (K,); for metrics only."""
        ...

    def encode(self, trajectory: Trajectories) -> tuple[Array, Array]:
        """One trajectory as real arrays for messages and bags: (T + 1, state_size), (T + 1, action_size)."""
        ...

    def decode(self, states: Array, actions: Array) -> Trajectories:
        """Inverse of ``encode``, checked step by step.

        Raises ImpossibleTrajectoryError for a wrong shape, a value that is no state or action of the game, or a
        transition that its dynamics do not allow.
        """
        ...


class TabularGame(ConstrainedMarkovGame, Protocol):
    """A game with S joint states, A joint actions and deterministic transitions, small enough to enumerate."""

    @property
    def n_states(self) -> int:
        """S."""
        ...

    @property
    def cost_features(self) -> TabularFeatureMap:
        """phi, which can be tabulated."""
        ...

    @property
    def reward_features(self) -> RewardFeatureMap:
        """Features of the reward models: theta weighs them or makes their weights. One per expert in every pair."""
        ...

    @property
    def n_actions(self) -> int:
        """A: joint actions."""
        ...

    @property
    def successor(self) -> Indices:
        """successor[s, a]: the joint state that follows, shape (S, A)."""
        ...

    @property
    def initial_distribution(self) -> Vector:
        """P_0, shape (S,)."""
        ...

    @property
    def violation(self) -> Mask:
        """violation[s, a]: does the pair break a hard constraint? Shape (S, A); for experts and metrics only."""
        ...

    @property
    def goal(self) -> Mask:
        """goal[s]: has every expert arrived? Shape (S,)."""
        ...

    @property
    def deadline(self) -> int:
        """Step by which the experts have arrived, at most T; for experts and metrics only."""
        ...

    @property
    def task_reward(self) -> Array:
        """The experts' own reward without constraints, shape (S, A); for experts and metrics only."""
        ...


class Experts(Protocol):
    """Who demonstrates."""

    @property
    def policy(self) -> Any:
        """The policy that they follow, where it is one that the game's judge can follow; else None."""
        ...

    def demonstrations(self, count: int, rng: np.random.Generator) -> Iterator[Trajectories]:
        """``count`` demonstrations of one trajectory each.

        Raises InfeasibleError where the game has none.
        """
        ...


class ImitationMetrics(NamedTuple):
    """How well a policy does what experts do, each in [0, 1].

    - CVR, constraint violation rate: probability that a trajectory breaks a true constraint at some step.
    - SR, success rate: probability that no true constraint is broken and every expert is at its goal at step T.
    """

    violation_rate: float
    success_rate: float


class Judge(Protocol):
    """How policies of a game are judged."""

    @property
    def method(self) -> str:
        """How the rates are found, for people."""
        ...

    def eval_iterations(self, count: int) -> list[int]:
        """Which of ``count`` iterations, from 1 on, are judged: always the first and the last."""
        ...

    def imitation(self, policy: Any, seed: int, rollouts: int | None = None) -> ImitationMetrics:
        """CVR and SR of a policy.

        Parameters
        ----------
        policy : Any
            Of the game.
        seed : int
            Of rollouts, where the judge takes some.
        rollouts : int or None
            How many it takes then; None: as many as it does by itself.

        Returns
        -------
        ImitationMetrics
            Exact, or shares of the rollouts.
        """
        ...

    def distance(self, policies: Sequence[Any], seed: int, rollouts: int | None = None) -> float:
        """Largest total variation distance between what two of the policies do, in [0, 1]."""
        ...

    def log_likelihoods(self, policy: Any, demonstrations: Trajectories) -> Vector | None:
        """log p of each demonstration under a policy, in nats, shape (m,); None where the game cannot say."""
        ...

    def constraint_confidences(self, reward: Any, parameters: Any, demonstrations: Trajectories) -> Vector | None:
        """Confidence that each cost feature is a constraint, shape (K,), -1 for those that were demonstrated.

        ``reward``: r_theta; ``parameters``: theta and omega. None where the game has no such test, and constraints are
        told by the threshold alone.
        """
        ...


class Learned(NamedTuple):
    """What a learner ended with: its policy, and which cost features are constraints, shape (K,)."""

    policy: Any
    omega: Vector
    constraints: Mask


class Game(ConstrainedMarkovGame, Protocol):
    """A game of an experiment file: everything about it that learners, players and reports ask for."""

    @property
    def expectations(self) -> tuple[str, ...]:
        """Kinds of ``algorithm.expectation`` that it can do, the first by default."""
        ...

    @property
    def expert_kinds(self) -> tuple[str, ...]:
        """Kinds of ``demonstrations.experts`` that it has; empty: it can only be demonstrated by recordings."""
        ...

    @property
    def judge(self) -> Judge:
        """Who says how well a policy does."""
        ...

    def expectation(self, kind: str, count: int) -> Any:
        """Step 2 of Algorithm 1 (``planners.interface.OccupancyEstimator``); ``count``: m, where sampled."""
        ...

    def linear_reward(self) -> Any:
        """r_theta = theta^T f of the reward features (``rewards.models.RewardModel``)."""
        ...

    def neural_reward(self, hidden: int, bound: float) -> Any:
        """r_theta of a small network with ``hidden`` units, |r_theta| <= ``bound``."""
        ...

    def true_reward(self) -> Any:
        """The experts' own reward, for methods that are given it."""
        ...

    def evaluation_planner(self, planner: Any, reward: Any) -> Any:
        """What finds the policy that theta and omega mean; ``planner``: the settings of the one that learned them."""
        ...

    def experts(self, kind: str, side: str) -> Experts:
        """Experts of one of ``expert_kinds``; ``side``: on which they pass obstacles, where they have a choice."""
        ...

    def measures(self, omega: Vector, demonstrations: Trajectories) -> Mapping[str, Mapping[str, float]]:
        """What reports of studies say of this game beside rates; nothing where there is no more to say.

        Parameters
        ----------
        omega : Vector
            Learned cost weights, shape (K,).
        demonstrations : Trajectories
            Of all learners.

        Returns
        -------
        Mapping
            By measure, such as ``obstacle_cost``, a value for each thing that it measures, by a name for people.
        """
        ...

    def figure(self, learned: Mapping[str, Learned], threshold: float, seed: int) -> Any:
        """A picture (matplotlib's Figure) of what learners or methods, by name, ended with."""
        ...

    def demonstrations_figure(self, demonstrations: Trajectories) -> Any:
        """A picture of the game with some demonstrations; None where there is none."""
        ...


def discounted_visitation(trajectories: Trajectories, discount: float) -> Visitation:
    """The pairs of m trajectories with weights gamma^t / m: totals over it are means of discounted sums."""
    count, steps = trajectories.states.shape[:2]
    weights = np.broadcast_to(discount ** np.arange(steps) / count, (count, steps))
    states, actions = (values.reshape(count * steps, *values.shape[2:]) for values in trajectories)
    return Visitation(states, actions, weights.ravel())
