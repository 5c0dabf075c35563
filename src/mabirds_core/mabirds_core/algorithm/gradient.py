"""The gradient of G at theta, omega: what the found policy does minus what was demonstrated (paper, section 4).

    grad_theta = E_pi grad J(zeta) - mean_i grad J(zeta_i)
    grad_omega = E_pi mu(zeta)     - mean_i mu(zeta_i),         pi = pi(omega, theta)

One policy is found for it, and its expectation is an average over rollouts or the occupancy measure itself.
Learners and central methods alike descend along it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from mabirds_core.algorithm.memory import Memory, WindowMemory
from mabirds_core.algorithm.parameters import Parameters, scaled
from mabirds_core.arithmetic import powers
from mabirds_core.arrays import Mask, Vector
from mabirds_core.costs.models import CostModel, costs_of
from mabirds_core.games.interface import ConstrainedMarkovGame, Visitation
from mabirds_core.planners.interface import OccupancyEstimator, Planner, Policy
from mabirds_core.rewards.models import RewardModel

COSTS = 1
"""Tells omega(1) from theta(1), where both are drawn."""

RolloutStart = Literal["initial", "demonstration"]


class Counts(NamedTuple):
    """Are the entries of theta's and of omega's expectations counts, which are never negative? All, or a mask's."""

    theta: bool | Mask
    omega: bool | Mask


class GradientEstimate(NamedTuple):
    """The two sides of the gradient at theta, omega, and the policy that was planned for them.

    Attributes
    ----------
    imagined : Parameters
        E_pi grad J(zeta) and E_pi mu(zeta); in omega also the gradient of what a cost model adds to the loss.
    observed : Parameters
        Means of grad J and mu over the demonstrations.
    policy : Policy
        pi(omega, theta).
    counts : Counts
        Which of them are counts.
    mass : float
        N_E sum_t gamma^t: what a feature would count that is active for every expert at every step.
    window_fill : float
        Share of the window that is filled; terms with n - i <= 0 are zero.
    """

    imagined: Parameters
    observed: Parameters
    policy: Policy
    counts: Counts
    mass: float
    window_fill: float = 1.0

    @property
    def gradient(self) -> Parameters:
        """imagined - observed, as far as the window is filled."""
        return scaled(
            self.window_fill,
            Parameters(self.imagined.theta - self.observed.theta, self.imagined.omega - self.observed.omega),
        )


@dataclass(frozen=True)
class GradientEstimator:
    """Steps 1 and 2 of Algorithm 1 and the differences of its step 4."""

    game: ConstrainedMarkovGame
    reward: RewardModel
    planner: Planner
    expectation: OccupancyEstimator
    rollout_start: RolloutStart = "demonstration"
    """Roll out from P_0 as the paper does ("initial"), or from the states in which the demonstrations began, which has
    the same mean and removes the variance that P_0 brings in.
    """

    def initial_parameters(self, seed: int) -> Parameters:
        """theta(1) of the reward model and omega(1) of the cost model, the same for all who share the seed."""
        theta = self.reward.initial(np.random.default_rng(seed))
        return Parameters(theta, self.costs.initial(np.random.default_rng([seed, COSTS])))

    def __call__(
        self,
        parameters: Parameters,
        memory: Memory,
        rng: np.random.Generator,
        previous: Policy | None = None,
    ) -> GradientEstimate:
        """Estimate the gradient for what was demonstrated.

        Parameters
        ----------
        parameters : Parameters
            theta(n), omega(n).
        memory : Memory
            The demonstrations until now, that of iteration n among them.
        rng : numpy.random.Generator
            Of rollouts, where the expectation takes some.
        previous : Policy, optional
            From which the planner starts.

        Returns
        -------
        GradientEstimate
            Expected and demonstrated counts, and the policy.
        """
        policy = self.planner.plan(*parameters, previous, rng, memory.examples)
        starts = memory.starts if self.rollout_start == "demonstration" else None
        visitation = self.expectation(policy, rng, starts)
        imagined = Parameters(self.reward.gradient(parameters.theta, visitation), self._paid(parameters, visitation))
        observed = memory.observed(parameters)
        return GradientEstimate(imagined, observed, policy, self.counts, self.mass, memory.fill)

    def generator(self, *seed: int) -> np.random.Generator:
        """Of an iteration's rollouts; one for all where nobody draws, as seeding takes longer than many sums.

        Parameters
        ----------
        *seed : int
            Of whom and of which iteration.

        Returns
        -------
        numpy.random.Generator
            New for each seed, unless neither planner nor expectation draws.
        """
        return np.random.default_rng(seed) if self._draws else self._never_drawn_from

    @cached_property
    def _draws(self) -> bool:
        """Planners and expectations that never draw say so."""
        return any(getattr(part, "draws", True) for part in (self.planner, self.expectation))

    @cached_property
    def _never_drawn_from(self) -> np.random.Generator:
        return np.random.default_rng(0)

    def _paid(self, parameters: Parameters, visitation: Visitation) -> Vector:
        """E_pi mu and, of costs with a penalty, its gradient."""
        costs, omega = self.costs, parameters.omega
        paid = costs.gradient_of_total(omega, costs.total(visitation))
        return paid if costs.linear else paid + costs.penalty_gradient(omega)

    @cached_property
    def costs(self) -> CostModel:
        """-c_omega."""
        return costs_of(self.game)

    @cached_property
    def counts(self) -> Counts:
        """Features that say nothing of their sign may have either."""
        return Counts(getattr(self.reward, "counts", False), self.costs.counts)

    @cached_property
    def mass(self) -> float:
        """N_E sum_t gamma^t."""
        game = self.game
        return float(game.n_experts * powers(game.discount, game.horizon + 1).sum())

    def window(self, length: int) -> WindowMemory:
        """An empty window of ``length`` iterations."""
        return WindowMemory(self.game, self.reward, length)
