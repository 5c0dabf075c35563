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

from mabirds_core.algorithm.gradient import GradientEstimator, stacked
from mabirds_core.algorithm.parameters import Parameters, StepSizes
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.errors import ScheduleError
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories
from mabirds_core.planners.interface import Policy


class LearnerState(NamedTuple):
    """A learner before its update n: theta(n), omega(n), and its demonstrations zeta(n-1), ..., zeta(n-l+1).

    ``policy``: what it found at iteration n - 1, from which the search at n starts.
    """

    iteration: int
    parameters: Parameters
    recent: tuple[Trajectories, ...]
    policy: Policy | None = None


class Lesson(NamedTuple):
    """What a demonstration teaches at theta(n), omega(n): a gradient of G, and what the next iteration needs."""

    gradient: Parameters
    recent: tuple[Trajectories, ...]
    policy: Policy


class Update(NamedTuple):
    """The state of iteration n + 1 and the gradient of G that led there."""

    state: LearnerState
    gradient: Parameters


@dataclass(frozen=True)
class Learner:
    """Learner v of the network: everything that does not change over the iterations."""

    index: int
    estimator: GradientEstimator
    schedule: EdgeSchedule
    steps: StepSizes
    window: int
    seed: int

    @property
    def game(self) -> ConstrainedMarkovGame:
        """The game that it watches."""
        return self.estimator.game

    def initial_state(self) -> LearnerState:
        """Iteration 1: theta(1) of the reward model, the same for every learner; omega(1) = 0."""
        return LearnerState(1, self.estimator.initial_parameters(self.seed), ())

    def update(self, state: LearnerState, demonstration: Trajectories, neighbours: Mapping[int, Parameters]) -> Update:
        """One iteration. ``neighbours`` holds theta(n), omega(n) of exactly the in-neighbours of E(n)."""
        lesson = self.learn(state, demonstration)
        after = self.steps.descend(self._mix(state, neighbours), lesson.gradient, state.iteration)
        return Update(LearnerState(state.iteration + 1, after, lesson.recent, lesson.policy), lesson.gradient)

    def learn(self, state: LearnerState, demonstration: Trajectories) -> Lesson:
        """Steps 1 to 3, the part of an iteration that needs nobody else."""
        recent = (demonstration, *state.recent)[: self.window]
        mean, policy = self.estimator(state.parameters, stacked(recent), self._rng(state.iteration), state.policy)
        share = len(recent) / self.window  # terms with n - i <= 0 are zero
        gradient = Parameters(share * mean.theta, share * mean.omega)
        return Lesson(gradient, recent[: self.window - 1], policy)

    def agree(self, state: LearnerState, neighbours: Mapping[int, Parameters]) -> LearnerState:
        """A closing round: theta and omega are mixed as at every iteration, and no step is taken.

        What is left of the learners' last steps of their own fades; on a complete graph one round ends in agreement.
        """
        return state._replace(iteration=state.iteration + 1, parameters=self._mix(state, neighbours))

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
