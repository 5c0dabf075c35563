"""What a constrained Markov game offers to learners, experts and metrics (paper, section 2).

A game is (states, actions, transitions, gamma, P_0, reward, cost features, horizon T) of N_E experts that act
together: a state and an action are those of all experts at once. Trajectories have T + 1 steps, t = 0..T.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mabirds_core.arithmetic import powers
from mabirds_core.arrays import Array, Indices, Mask, Vector

Steps = NDArray[Any]
"""Joint states or actions: an index each in a tabular game, a row of real numbers each in a continuous one."""


class Trajectories(NamedTuple):
    """m joint trajectories; axis 0 counts trajectories, axis 1 the steps t = 0..T.

    Attributes
    ----------
    states : Steps
        Joint state indices, shape (m, T + 1), in a tabular game; numbers, shape (m, T + 1, D_s), in a continuous one.
    actions : Steps
        Joint action indices, shape (m, T + 1), in a tabular game; numbers, shape (m, T + 1, D_a), in a continuous one.
    """

    states: Steps
    actions: Steps


class Visitation(NamedTuple):
    """A weighted set of M state-action pairs: sum_k weights[k] f(states[k], actions[k]) estimates E sum_t gamma^t f.

    One trajectory, a batch of rollouts and an exact occupancy measure all take this form, so that features and
    reward gradients are summed by one function each.

    Attributes
    ----------
    states : Steps
        Joint states, one per row of axis 0.
    actions : Steps
        Joint actions, one per row of axis 0.
    weights : Vector
        Shape (M,).
    """

    states: Steps
    actions: Steps
    weights: Vector


class ShownFeatures(NamedTuple):
    """What demonstrations show of cost features.

    Attributes
    ----------
    used : Mask
        Which of them some demonstration had, shape (K,).
    demonstrations : int
        N: how many there were.
    """

    used: Mask
    demonstrations: int


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
    def true_constraints(self) -> Mask | None:
        """Which cost features the experts really may not touch, shape (K,); for metrics only. None: nobody knows."""
        ...

    def encode(self, trajectory: Trajectories) -> tuple[Array, Array]:
        """One trajectory as real arrays for messages and bags: (T + 1, state_size), (T + 1, action_size)."""
        ...

    def decode(self, states: Array, actions: Array) -> Trajectories:
        """Inverse of ``encode``, checked step by step.

        Parameters
        ----------
        states : Array
            Shape (T + 1, state_size).
        actions : Array
            Shape (T + 1, action_size).

        Returns
        -------
        Trajectories
            One trajectory.

        Raises
        ------
        ImpossibleTrajectoryError
            A shape is wrong, a value is no state or action of the game, or its dynamics do not allow a transition.
        """
        ...


class Transitions(Protocol):
    """P(s' | s, a) of S joint states and A joint actions."""

    @property
    def deterministic(self) -> bool:
        """Does every pair lead to a single state? Then it is ``TabularGame.successor``."""
        ...

    def expected(self, values: Vector, states: Indices | slice) -> Array:
        """What follows on average.

        Parameters
        ----------
        values : Vector
            Of joint states, shape (S,).
        states : Indices or slice
            M of them.

        Returns
        -------
        Array
            sum_s' P(s' | s, a) values[s'], shape (M, A).
        """
        ...

    def onward(self, pairs: Array, states: Indices | slice) -> Vector:
        """Where probability goes.

        Parameters
        ----------
        pairs : Array
            Probabilities of state-action pairs, shape (M, A).
        states : Indices or slice
            The M joint states.

        Returns
        -------
        Vector
            Probabilities of the joint states after, shape (S,).
        """
        ...

    def draw(self, states: Indices, actions: Indices, rng: np.random.Generator) -> Indices:
        """Draw what follows pairs.

        Parameters
        ----------
        states : Indices
            Joint states, shape (M,).
        actions : Indices
            A joint action in each, shape (M,).
        rng : np.random.Generator
            Not used where there is no choice.

        Returns
        -------
        Indices
            Joint states after, shape (M,).
        """
        ...


class TabularGame(ConstrainedMarkovGame, Protocol):
    """A game with S joint states and A joint actions, small enough to enumerate."""

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
        """successor[s, a]: the joint state that follows where everything goes as chosen, shape (S, A)."""
        ...

    @property
    def transitions(self) -> Transitions:
        """P(s' | s, a)."""
        ...

    @property
    def initial_distribution(self) -> Vector:
        """P_0, shape (S,)."""
        ...

    @property
    def violation(self) -> Mask:
        """violation[s, a]: does the pair break a hard constraint? Shape (S, A); for experts and metrics only.

        Raises
        ------
        UnknownTruthError
            Nobody knows.
        """
        ...

    @property
    def violation_cost(self) -> float:
        """What a step with a violation, or too late, costs experts; infinite where they can avoid it."""
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


def shown_features(game: ConstrainedMarkovGame, demonstrations: Trajectories) -> ShownFeatures:
    """What demonstrations show of the game's cost features.

    Parameters
    ----------
    game : ConstrainedMarkovGame
        With non-negative cost features.
    demonstrations : Trajectories
        N of them.

    Returns
    -------
    ShownFeatures
        Those with a count above 0.
    """
    counts = game.cost_features.total(discounted_visitation(demonstrations, game.discount))
    return ShownFeatures(counts > 0, len(demonstrations.states))


def discounted_visitation(trajectories: Trajectories, discount: float) -> Visitation:
    """The pairs of m trajectories: totals over them are means of discounted sums.

    Parameters
    ----------
    trajectories : Trajectories
        m of them.
    discount : float
        gamma.

    Returns
    -------
    Visitation
        With weights gamma^t / m.
    """
    count, steps = trajectories.states.shape[:2]
    of_steps = powers(discount, steps)
    weights = of_steps if count == 1 else np.tile(of_steps / count, count)
    states, actions = (values.reshape(count * steps, *values.shape[2:]) for values in trajectories)
    return Visitation(states, actions, weights)
