"""BICS: the bi-level single loop of MA-BIRDS with one central learner (paper, section 5).

With all N_L new demonstrations of iteration n at hand there is nothing to agree on, so W = 1 and

    omega <- omega - alpha(n) grad_omega,   theta <- theta - beta(n) grad_theta

for the mean loss of the last l iterations' demonstrations of all streams: one policy and one step per iteration.

ME-gradient (Malik, Anwar, Aghasi and Ahmed, ICML 2021) is the same with the true reward given: theta is empty, and
omega ascends the likelihood of the demonstrations under the maximum-entropy policy of that reward.
"""

from dataclasses import dataclass

import numpy as np

from mabirds_core.algorithm.gradient import GradientEstimator, stacked
from mabirds_core.algorithm.parameters import Parameters, StepSizes
from mabirds_core.baselines.interface import CentralState, first_state
from mabirds_core.games.interface import Trajectories


@dataclass(frozen=True)
class Bics:
    """``window``: l, iterations whose demonstrations make a gradient."""

    estimator: GradientEstimator
    steps: StepSizes
    window: int
    seed: int

    def initial_state(self) -> CentralState:
        """theta(1) of the reward model, omega(1) = 0."""
        return first_state(self.estimator, self.seed)

    def update(self, state: CentralState, demonstrations: Trajectories) -> CentralState:
        """One gradient step."""
        n = state.iteration
        recent = (demonstrations, *state.seen)[: self.window]
        rng = np.random.default_rng([self.seed, n])
        mean, policy = self.estimator(state.parameters, stacked(recent), rng, state.policy)
        window_fill = len(recent) / self.window  # terms with n - i <= 0 are zero
        gradient = Parameters(window_fill * mean.theta, window_fill * mean.omega)
        after = self.steps.descend(state.parameters, gradient, n)
        return CentralState(n + 1, after, recent[: self.window - 1], policy, state.work.more(1, 1))
