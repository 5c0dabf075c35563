"""What the judge of a game says of policies and of learned parameters."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from mabirds_core.arrays import Vector
from mabirds_core.games.interface import ShownFeatures, Trajectories


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
