"""FTL: follow the leader, the baseline [22] of the paper in single-loop bi-level form.

At iteration n it descends the mean of all losses so far, over every demonstration of every stream,

    G_n(theta, omega) = 1 / (n N_L) sum_{i <= n} sum_v G(theta, omega; zeta_v(i)),

theta and omega together, until the gradient's largest entry is at most ``tolerance`` or ``max_steps`` are made.
Step sizes decay over all steps since the beginning. Every step needs a policy of its own.
"""

from dataclasses import dataclass, replace

import numpy as np

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.memory import WindowMemory
from mabirds_core.algorithm.parameters import Parameters, descend
from mabirds_core.algorithm.steps import StepRule
from mabirds_core.baselines.interface import CentralState, first_state
from mabirds_core.games.interface import Trajectories


@dataclass(frozen=True)
class Ftl:
    """Follow the leader.

    Attributes
    ----------
    estimator : GradientEstimator
        Of the gradient.
    steps : StepRule
        The step rule.
    tolerance : float
        Of the stationary point, in discounted counts.
    max_steps : int
        Per iteration.
    seed : int
        Of theta(1) and of rollouts.
    """

    estimator: GradientEstimator
    steps: StepRule
    tolerance: float
    max_steps: int
    seed: int

    def initial_state(self) -> CentralState:
        """theta(1) of the reward model, omega(1) = 0."""
        return first_state(self.estimator, self.steps, self.estimator.window(0), self.seed)

    def update(self, state: CentralState, demonstrations: Trajectories) -> CentralState:
        """Gradient steps on the sum of all losses until it is nearly stationary."""
        n, rng = state.iteration, np.random.default_rng([self.seed, state.iteration])
        everything: WindowMemory = replace(state.memory, length=n).add(demonstrations)
        parameters, policy, rule = state.parameters, state.policy, state.rule
        for made in range(self.max_steps + 1):
            estimate = self.estimator(parameters, everything, rng, policy)
            policy = estimate.policy
            if made == self.max_steps or largest(estimate.gradient) <= self.tolerance:
                break
            number = state.work.gradient_steps + made + 1
            step, rule = self.steps.step(rule, estimate, number)
            parameters = descend(parameters, step, number)
        return CentralState(n + 1, parameters, everything, rule, policy, state.work.more(made, made + 1))


def largest(gradient: Parameters) -> float:
    """The largest absolute entry of both gradients."""
    return max(float(np.abs(part).max()) for part in gradient)
