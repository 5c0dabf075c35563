"""What an experiment asks of a game beside what learners ask: experts, rewards, planners, a judge and pictures.

A game of an experiment file is such a whole game (``Game``).
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from mabirds_core.arrays import Mask, Vector
from mabirds_core.games.interface import ConstrainedMarkovGame, ShownFeatures, Trajectories


class Experts(Protocol):
    """Who demonstrates."""

    @property
    def policy(self) -> Any:
        """The policy that they follow, where it is one that the game's judge can follow; else None."""
        ...

    def demonstrations(self, count: int, rng: np.random.Generator) -> Iterator[Trajectories]:
        """Demonstrate.

        Parameters
        ----------
        count : int
            How many demonstrations.
        rng : np.random.Generator
            Of the experts' choices.

        Yields
        ------
        Trajectories
            One each.

        Raises
        ------
        InfeasibleError
            The game has none.
        """
        ...


class ImitationMetrics(NamedTuple):
    """How well a policy does what experts do.

    Attributes
    ----------
    violation_rate : float
        CVR: probability that a trajectory breaks a true constraint at some step, in [0, 1].
    success_rate : float
        SR: probability that no true constraint is broken and every expert is at its goal at step T, in [0, 1].
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

    def imitation(self, policy: Any, seed: int, rollouts: int | None = None) -> ImitationMetrics | None:
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
        ImitationMetrics or None
            Exact, or shares of the rollouts; None where nobody knows the true constraints.
        """
        ...

    def distance(self, policies: Sequence[Any], seed: int, rollouts: int | None = None) -> float:
        """Largest total variation distance between what two of the policies do.

        Parameters
        ----------
        policies : Sequence[Any]
            Of the game.
        seed : int
            Of rollouts, where the judge takes some.
        rollouts : int, optional
            How many it takes then; None: as many as it does by itself.

        Returns
        -------
        float
            In [0, 1].
        """
        ...

    def distance_to(self, policy: Any, demonstrations: Trajectories, seed: int) -> float | None:
        """Total variation distance between what a policy does and what is demonstrated.

        Parameters
        ----------
        policy : Any
            Of the game.
        demonstrations : Trajectories
            At least one.
        seed : int
            Of rollouts, where the judge takes some.

        Returns
        -------
        float or None
            In [0, 1]; None where the experts' own policies are at hand, and ``distance`` to them says more.
        """
        ...

    def log_likelihoods(self, policy: Any, demonstrations: Trajectories) -> Vector | None:
        """log p of each demonstration under a policy.

        Parameters
        ----------
        policy : Any
            Of the game.
        demonstrations : Trajectories
            m of them.

        Returns
        -------
        Vector or None
            In nats, shape (m,), of continuous actions relative to the uniform policy; None where the game cannot say.
        """
        ...

    def fixed_log_likelihoods(self, policy: Any, demonstrations: Trajectories) -> Mapping[str, float]:
        """What ``log_likelihoods`` are to be compared with: those of policies that take no learning.

        Parameters
        ----------
        policy : Any
            A learned one, which says in which moves demonstrations are told.
        demonstrations : Trajectories
            m of them.

        Returns
        -------
        Mapping
            Means over the demonstrations by the name of the fixed policy [nats]; empty where there are none.
        """
        ...

    def value(self, policy: Any, seed: int) -> float | None:
        """Mean of the value V_0 that a planner gave the starts.

        Parameters
        ----------
        policy : Any
            Of the game.
        seed : int
            Of starts, where the judge draws some.

        Returns
        -------
        float or None
            In nats; None where the policy has no values.
        """
        ...

    def certificate(self, policy: Any, seed: int) -> float | None:
        """By how much the value that a planner gave its policy differs from what the policy's trajectories earn.

        Parameters
        ----------
        policy : Any
            Of the game.
        seed : int
            Of rollouts, where the judge takes some.

        Returns
        -------
        float or None
            Largest | V_0(s_0) - sum_t gamma^t ( r_t - log pi_t ) | over some rollouts [nats]; None where there is no
            such value.
        """
        ...

    def constraint_confidences(self, reward: Any, parameters: Any, shown: ShownFeatures) -> Vector | None:
        """Confidence that each cost feature is a constraint.

        Parameters
        ----------
        reward : Any
            r_theta.
        parameters : Any
            theta and omega.
        shown : ShownFeatures
            By a learner's own demonstrations.

        Returns
        -------
        Vector or None
            Shape (K,), -1 for features that were demonstrated. None where the game has no such test, and constraints
            are told by the threshold alone.
        """
        ...


class Learned(NamedTuple):
    """What a learner ended with.

    Attributes
    ----------
    policy : Any
        Of its theta and omega.
    omega : Vector
        Shape (K,).
    constraints : Mask
        Which cost features are constraints, shape (K,).
    """

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
        """Build step 2 of Algorithm 1.

        Parameters
        ----------
        kind : str
            One of ``expectations``.
        count : int
            m: rollouts, where sampled.

        Returns
        -------
        Any
            A ``planners.interface.OccupancyEstimator``.
        """
        ...

    def linear_reward(self) -> Any:
        """r_theta = theta^T f of the reward features (``rewards.models.RewardModel``)."""
        ...

    def neural_reward(self, hidden: int, bound: float) -> Any:
        """r_theta of a small network.

        Parameters
        ----------
        hidden : int
            Units of the hidden layer.
        bound : float
            C: |r_theta| <= C.

        Returns
        -------
        Any
            A ``rewards.models.RewardModel``.
        """
        ...

    def true_reward(self) -> Any:
        """The experts' own reward, for methods that are given it."""
        ...

    def evaluation_planner(self, planner: Any, reward: Any) -> Any:
        """Build what finds the policy that theta and omega mean.

        Parameters
        ----------
        planner : Any
            Settings of the planner that learned them.
        reward : Any
            r_theta.

        Returns
        -------
        Any
            A ``planners.interface.Planner``.
        """
        ...

    def judging_planners(self, planner: Any, reward: Any) -> Mapping[str, Any]:
        """Build planners that never serve learning, and share no error of the one that does.

        Parameters
        ----------
        planner : Any
            Settings of the planner that learned.
        reward : Any
            r_theta.

        Returns
        -------
        Mapping
            A ``planners.interface.Planner`` by its name for people; empty where the evaluation planner is exact.
        """
        ...

    def experts(self, kind: str, side: str) -> Experts:
        """Build experts.

        Parameters
        ----------
        kind : str
            One of ``expert_kinds``.
        side : str
            On which they pass obstacles, where they have a choice.

        Returns
        -------
        Experts
            Who demonstrate.
        """
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
        """Draw what learners or methods ended with.

        Parameters
        ----------
        learned : Mapping[str, Learned]
            By the name of the learner or method.
        threshold : float
            -omega from which on a feature counts as a constraint.
        seed : int
            Of rollouts, where some are drawn.

        Returns
        -------
        Any
            matplotlib's Figure.
        """
        ...

    def demonstrations_figure(self, demonstrations: Trajectories) -> Any:
        """A picture of the game with some demonstrations; None where there is none."""
        ...
