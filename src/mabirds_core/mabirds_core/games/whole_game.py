"""What an experiment asks of a game beside what learners ask: experts, rewards, planners, a judge and pictures.

A game of an experiment file is such a whole game (``Game``).
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from mabirds_core.arrays import Mask, Vector
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories
from mabirds_core.games.judging import Judge


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
