"""DLM: the double loop, online D-ICRL.

At iteration n, for the demonstrations of the last l iterations of all streams,

    inner loop: omega <- omega - alpha(k) grad_omega,  k = 1, 2, ...,  until |grad_omega| <= tolerance
    outer step: theta <- theta - beta(n) grad_theta    at that omega

so that the outer gradient is taken where the inner problem, the dual over omega, is solved. ``tolerance`` bounds the
largest entry; the inner loop also ends after ``max_steps``. Every inner step needs a policy of its own.
"""

from dataclasses import dataclass

import numpy as np

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.parameters import descend
from mabirds_core.algorithm.steps import StepRule
from mabirds_core.baselines.interface import CentralState, first_state
from mabirds_core.games.interface import Trajectories


@dataclass(frozen=True)
class Dlm:
    """The double loop.

    Attributes
    ----------
    estimator : GradientEstimator
        Of the gradient.
    steps : StepRule
        The step rule of either loop.
    window : int
        l.
    tolerance : float
        Of the inner problem, in discounted counts.
    max_steps : int
        Of the inner loop.
    seed : int
        Of theta(1) and of rollouts.
    """

    estimator: GradientEstimator
    steps: StepRule
    window: int
    tolerance: float
    max_steps: int
    seed: int

    def initial_state(self) -> CentralState:
        """theta(1) of the reward model, omega(1) = 0."""
        return first_state(self.estimator, self.steps, self.estimator.window(self.window), self.seed)

    def update(self, state: CentralState, demonstrations: Trajectories) -> CentralState:
        """The inner problem to its tolerance, then one step of theta. The inner loop's rule begins anew each time."""
        n, rng, memory = (
            state.iteration,
            np.random.default_rng([self.seed, state.iteration]),
            state.memory.add(demonstrations),
        )
        parameters, policy, inner = state.parameters, state.policy, self.steps.initial(state.parameters)
        for made in range(self.max_steps + 1):
            # Its losses are means over what there is of the window.
            estimate = self.estimator(parameters, memory, rng, policy)._replace(window_fill=1.0)
            policy = estimate.policy
            if made == self.max_steps or np.abs(estimate.gradient.omega).max() <= self.tolerance:
                break
            step, inner = self.steps.step(inner, estimate, made + 1)
            parameters = descend(parameters, step._replace(theta=np.zeros_like(step.theta)), made + 1)
        step, outer = self.steps.step(state.rule, estimate, n)
        parameters = descend(parameters, step._replace(omega=np.zeros_like(step.omega)), n)
        work = state.work.more(made + 1, made + 1)
        return CentralState(n + 1, parameters, memory, outer, policy, work)
