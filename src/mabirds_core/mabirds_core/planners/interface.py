"""What Algorithm 1 asks of a policy and of the planner that makes one from theta and omega."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.interface import Steps, Trajectories, Visitation

Policy = Any
"""pi_t(a | s) of some game. Algorithm 1 only hands it on, from a planner to an expectation of the same game."""


class TabularPolicy(Protocol):
    """A time-dependent stochastic policy pi_t(a | s) of a tabular game."""

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """log pi_t(a | s) of M joint states.

        Parameters
        ----------
        step : int
            t.
        states : Indices
            Joint states, shape (M,).

        Returns
        -------
        Array
            Shape (M, A); -inf where an action is never taken.
        """
        ...


class Planner(Protocol):
    """Step 1 of Algorithm 1: the constrained soft Bellman policy of r_theta + omega^T phi.

    One that never draws from ``rng`` may say so by ``draws = False``: seeding a generator takes 20 us.
    """

    def plan(
        self,
        theta: Vector,
        omega: Vector,
        previous: Policy | None = None,
        rng: np.random.Generator | None = None,
        observed: Trajectories | None = None,
    ) -> Policy:
        """The policy for these parameters.

        Parameters
        ----------
        theta : Vector
            Reward parameters, shape (K_theta,).
        omega : Vector
            Cost weights, shape (K_omega,).
        previous : Policy, optional
            The policy of parameters nearby, from which a search may start.
        rng : np.random.Generator, optional
            For planners that sample.
        observed : Trajectories, optional
            Demonstrations, which show planners that sample what the game is like where experts are.

        Returns
        -------
        Policy
            pi(omega, theta). Exact planners need no more than theta and omega for it.
        """
        ...

    def state_dict(self, policy: Policy) -> dict[str, Array]:
        """What a later search that starts from ``policy`` needs of it, as arrays by name; empty: nothing."""
        ...

    def load_state_dict(self, memory: Mapping[str, Array]) -> Policy | None:
        """A policy that serves as ``previous`` just as the one in ``memory`` did.

        Raises
        ------
        CheckpointError
            ``memory`` is of another game or planner.
        """
        ...


class OccupancyEstimator(Protocol):
    """Step 2 of Algorithm 1: how E_pi sum_t gamma^t f(s_t, a_t) is found. ``draws``: as of a planner."""

    def __call__(self, policy: Policy, rng: np.random.Generator, starts: Steps | None = None) -> Visitation:
        """Estimate where a policy goes.

        Parameters
        ----------
        policy : Policy
            Of the game.
        rng : np.random.Generator
            For estimates that sample.
        starts : Steps, optional
            States, shape (k,), each of them an equally likely start; None: starts are drawn from P_0.

        Returns
        -------
        Visitation
            Its totals are, or estimate, the policy's expected discounted sums.
        """
        ...
