"""BICS: the bi-level single loop of MA-BIRDS with one central learner (paper, section 5).

With all N_L new demonstrations of iteration n at hand there is nothing to agree on, so W = 1 and

    omega <- omega - alpha(n) grad_omega,   theta <- theta - beta(n) grad_theta

for the mean loss of the demonstrations of all streams, of the last l iterations or of all: one policy and one step of
the algorithm's rule per iteration.

ME-gradient (Malik, Anwar, Aghasi and Ahmed, ICML 2021) is the same with the true reward given: theta is empty, and
omega ascends the likelihood of the demonstrations under the maximum-entropy policy of that reward.
"""

from dataclasses import dataclass

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.memory import Memory
from mabirds_core.algorithm.parameters import descend
from mabirds_core.algorithm.steps import StepRule
from mabirds_core.baselines.interface import CentralState, first_state
from mabirds_core.games.interface import Trajectories


@dataclass(frozen=True)
class Bics:
    """The single loop with one central learner.

    Attributes
    ----------
    estimator : GradientEstimator
        Of the gradient.
    steps : StepRule
        The step rule.
    memory : Memory
        That of iteration 1, which is empty.
    seed : int
        Of theta(1) and of rollouts.
    """

    estimator: GradientEstimator
    steps: StepRule
    memory: Memory
    seed: int

    def initial_state(self) -> CentralState:
        """theta(1) of the reward model, omega(1) = 0."""
        return first_state(self.estimator, self.steps, self.memory, self.seed)

    def update(self, state: CentralState, demonstrations: Trajectories) -> CentralState:
        """One gradient step."""
        n, memory = state.iteration, state.memory.add(demonstrations)
        estimate = self.estimator(state.parameters, memory, self.estimator.generator(self.seed, n), state.policy)
        step, rule = self.steps.step(state.rule, estimate, n)
        after = descend(state.parameters, step, n)
        return CentralState(n + 1, after, memory, rule, estimate.policy, state.work.more(1, 1))
