"""DLM: the double loop, online D-ICRL.

At iteration n, for the demonstrations of the last l iterations of all streams,

    inner loop: omega <- omega - alpha(k) grad_omega,  k = 1, 2, ...,  until |grad_omega| <= tolerance
    outer step: theta <- theta - beta(n) grad_theta    at that omega

so that the outer gradient is taken where the inner problem, the dual over omega, is solved. ``tolerance`` bounds the
largest entry; the inner loop also ends after ``most_steps``. Every inner step needs a policy of its own.
"""

from dataclasses import dataclass

import numpy as np

from mabirds_core.algorithm.gradient import GradientEstimator, stacked
from mabirds_core.algorithm.parameters import Parameters, StepSizes
from mabirds_core.baselines.interface import CentralState, first_state
from mabirds_core.games.interface import Trajectories


@dataclass(frozen=True)
class Dlm:
    """``window``: l. ``tolerance``: of the inner problem, in discounted counts. ``most_steps``: of the inner loop."""

    estimator: GradientEstimator
    steps: StepSizes
    window: int
    tolerance: float
    most_steps: int
    seed: int

    def initial_state(self) -> CentralState:
        """theta(1) of the reward model, omega(1) = 0."""
        return first_state(self.estimator, self.seed)

    def update(self, state: CentralState, demonstrations: Trajectories) -> CentralState:
        """The inner problem to its tolerance, then one step of theta."""
        n, rng = state.iteration, np.random.default_rng([self.seed, state.iteration])
        recent = (demonstrations, *state.seen)[: self.window]
        observed, parameters, policy = stacked(recent), state.parameters, state.policy
        for made in range(self.most_steps + 1):
            gradient, policy = self.estimator(parameters, observed, rng, policy)
            if made == self.most_steps or np.abs(gradient.omega).max() <= self.tolerance:
                break
            inner = Parameters(np.zeros_like(gradient.theta), gradient.omega)
            parameters = self.steps.descend(parameters, inner, made + 1)
        outer = Parameters(gradient.theta, np.zeros_like(gradient.omega))
        parameters = self.steps.descend(parameters, outer, n)
        work = state.work.more(made + 1, made + 1)
        return CentralState(n + 1, parameters, recent[: self.window - 1], policy, work)
