"""Algorithm 1: one learner's online iteration (paper, section 4).

At iteration n learner v holds theta, omega and
  1. finds the constrained soft Bellman policy pi(omega, theta),
  2. draws m trajectories zeta^j from it (or takes their expectation),
  3. has received theta_u, omega_u of iteration n from its neighbours, and its demonstration zeta(n),
  4. omega <- sum_u W(n)[v,u] omega_u - alpha(n)/l sum_{i<l} ( mean_j mu(zeta^j)     - mu(zeta(n-i)) )
     theta <- sum_u W(n)[v,u] theta_u - beta(n)/l  sum_{i<l} ( mean_j grad J(zeta^j) - grad J(zeta(n-i)) )
with alpha(n) = abar / n^eta1, beta(n) = bbar / n^eta2; terms with n - i <= 0 are zero.

This one function serves the in-process network and the ROS nodes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from mabirds_core.arrays import Vector
from mabirds_core.errors import DivergenceError, ScheduleError
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories, Visitation, discounted_visitation
from mabirds_core.policies.interface import Expectation, PolicyFinder
from mabirds_core.rewards import RewardModel
from mabirds_core.schedule import EdgeSchedule

LARGEST = 1e100
"""No parameter may be larger: sums over features and steps would overflow."""


class StepSizes(BaseModel):
    """alpha(n) = alpha / n^eta1 for omega, beta(n) = beta / n^eta2 for theta."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    alpha: float = Field(gt=0, description="abar: first step of omega")
    beta: float = Field(gt=0, description="bbar: first step of theta")
    eta1: float = Field(0.51, gt=0.5, lt=1, description="decay of alpha")
    eta2: float = Field(0.51, gt=0.5, lt=1, description="decay of beta")

    def at(self, iteration: int) -> tuple[float, float]:
        """alpha(n), beta(n).

        >>> StepSizes(alpha=8, beta=4, eta1=0.75, eta2=0.75).at(16)
        (1.0, 0.5)
        """
        return self.alpha / iteration**self.eta1, self.beta / iteration**self.eta2


class Parameters(NamedTuple):
    """What learners exchange: theta (reward parameters) and omega (cost weights)."""

    theta: Vector
    omega: Vector


class LearnerState(NamedTuple):
    """A learner before its update n: theta(n), omega(n), and its demonstrations zeta(n-1), ..., zeta(n-l+1)."""

    iteration: int
    parameters: Parameters
    recent: tuple[Trajectories, ...]


class Update(NamedTuple):
    """The state of iteration n + 1 and the gradient of G that led there."""

    state: LearnerState
    gradient: Parameters


@dataclass(frozen=True)
class Learner:
    """Learner v of the network: everything that does not change over the iterations."""

    index: int
    game: ConstrainedMarkovGame
    reward: RewardModel
    finder: PolicyFinder
    expectation: Expectation
    schedule: EdgeSchedule
    steps: StepSizes
    window: int
    seed: int

    def initial_state(self) -> LearnerState:
        """Iteration 1: theta(1) of the reward model, the same for every learner; omega(1) = 0."""
        theta = self.reward.initial(np.random.default_rng(self.seed))
        return LearnerState(1, Parameters(theta, np.zeros(len(self.game.cost_features.names))), ())

    def update(self, state: LearnerState, demonstration: Trajectories, neighbours: Mapping[int, Parameters]) -> Update:
        """One iteration. ``neighbours`` holds theta(n), omega(n) of exactly the in-neighbours of E(n)."""
        theta, omega = state.parameters
        policy = self.finder.find(theta, omega)
        imagined = self.expectation(policy, self._rng(state.iteration))
        recent = (demonstration, *state.recent)[: self.window]
        gradient = self._gradient(theta, imagined, recent)
        mixed = self._mix(state, neighbours)
        alpha, beta = self.steps.at(state.iteration)
        after = Parameters(mixed.theta - beta * gradient.theta, mixed.omega - alpha * gradient.omega)
        if not all((np.abs(values) <= LARGEST).all() for values in after):
            raise DivergenceError(
                f"iteration {state.iteration} carried theta or omega past {LARGEST:g}; lower alpha and beta"
            )
        return Update(LearnerState(state.iteration + 1, after, recent[: self.window - 1]), gradient)

    def _gradient(self, theta: Vector, imagined: Visitation, recent: tuple[Trajectories, ...]) -> Parameters:
        """1/l sum_{i<l} ( E_pi f - f(zeta(n-i)) ) for f = grad J and f = mu."""
        features = self.game.cost_features
        observed = [discounted_visitation(trajectory, self.game.discount) for trajectory in recent]
        grad_j, mu = self.reward.gradient(theta, imagined), features.total(imagined)
        return Parameters(
            sum((grad_j - self.reward.gradient(theta, one) for one in observed), np.zeros_like(theta)) / self.window,
            sum((mu - features.total(one) for one in observed), np.zeros_like(mu)) / self.window,
        )

    def _mix(self, state: LearnerState, neighbours: Mapping[int, Parameters]) -> Parameters:
        """sum_u W(n)[v, u] (theta_u, omega_u), summed in the order of the learners' list."""
        expected = self.schedule.in_neighbours(self.index, state.iteration)
        if sorted(neighbours) != expected:
            raise ScheduleError(
                f"iteration {state.iteration}: parameters of learners {sorted(neighbours)}, expected {expected}"
            )
        row = self.schedule.weights(state.iteration)[self.index]
        known = {**neighbours, self.index: state.parameters}
        theta, omega = (np.zeros_like(own) for own in state.parameters)
        for learner in sorted(known):
            theta = theta + row[learner] * known[learner].theta
            omega = omega + row[learner] * known[learner].omega
        return Parameters(theta, omega)

    def _rng(self, iteration: int) -> np.random.Generator:
        """A generator of its own for each learner and iteration, so that a restart needs no saved generator."""
        return np.random.default_rng([self.seed, self.index, iteration])
