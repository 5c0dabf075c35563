"""Algorithm 1: one learner's online iteration (paper, section 4).

At iteration n learner v holds theta, omega and
  1. finds the constrained soft Bellman policy pi(omega, theta),
  2. draws m trajectories zeta^j from it (or takes their expectation),
  3. has received theta_u, omega_u of iteration n from its neighbours, and its demonstration zeta(n),
  4. omega <- sum_u W(n)[v,u] omega_u - alpha(n)/l sum_{i<l} ( mean_j mu(zeta^j)     - mu(zeta(n-i)) )
     theta <- sum_u W(n)[v,u] theta_u - beta(n)/l  sum_{i<l} ( mean_j grad J(zeta^j) - grad J(zeta(n-i)) )
with alpha(n) = abar / n^eta1, beta(n) = bbar / n^eta2; terms with n - i <= 0 are zero.

Step 4 is a mixer's: strict as written here, or by push-sum. This one function serves the in-process network and the
ROS nodes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mabirds_core.algorithm.gradient import GradientEstimator, stacked
from mabirds_core.algorithm.parameters import Parameters, StepSizes
from mabirds_core.consensus.mixer import AnyMixer, MixerState
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories
from mabirds_core.planners.interface import Policy


class LearnerState(NamedTuple):
    """A learner before its update n: theta(n), omega(n), and its demonstrations zeta(n-1), ..., zeta(n-l+1).

    ``mixing``: what its mixer knows, theta(n) and omega(n) among it. ``policy``: what it found at iteration n - 1,
    from which the search at n starts.
    """

    iteration: int
    mixing: MixerState
    recent: tuple[Trajectories, ...]
    policy: Policy | None = None

    @property
    def parameters(self) -> Parameters:
        """theta(n), omega(n)."""
        return self.mixing.parameters


class LocalGradient(NamedTuple):
    """The gradient of G at theta(n), omega(n) for the demonstrations of the window, and what iteration n + 1 needs."""

    gradient: Parameters
    recent: tuple[Trajectories, ...]
    policy: Policy


class StepResult(NamedTuple):
    """The state of iteration n + 1 and the gradient of G that led there."""

    state: LearnerState
    gradient: Parameters


@dataclass(frozen=True)
class Learner:
    """Learner v of the network: everything that does not change over the iterations."""

    index: int
    estimator: GradientEstimator
    mixer: AnyMixer
    steps: StepSizes
    window: int
    seed: int

    @property
    def game(self) -> ConstrainedMarkovGame:
        """The game that it watches."""
        return self.estimator.game

    def initial_state(self) -> LearnerState:
        """Iteration 1: theta(1) of the reward model, the same for every learner; omega(1) = 0."""
        return LearnerState(1, self.mixer.initial(self.estimator.initial_parameters(self.seed)), ())

    def step(self, state: LearnerState, demonstration: Trajectories, incoming: Mapping[str, Any]) -> StepResult:
        """Iteration n, all four steps.

        ``demonstration``: zeta(n). ``incoming``: what in-neighbours of E(n) have sent, by their names, for the mixer.
        """
        local, n = self.local_gradient(state, demonstration), state.iteration

        def descend(origin: Parameters) -> Parameters:
            return self.steps.descend(origin, local.gradient, n)

        mixed = self.mixer.mix(self.mixer.incoming(state.mixing, n, incoming), n, descend)
        return StepResult(LearnerState(n + 1, mixed, local.recent, local.policy), local.gradient)

    def local_gradient(self, state: LearnerState, demonstration: Trajectories) -> LocalGradient:
        """Steps 1 to 3, the part of an iteration that needs nobody else.

        (1/l) sum_{i<l} ( mean_j grad J(zeta^j) - grad J(zeta(n-i)) ) in theta, and the same of mu in omega.
        """
        recent = (demonstration, *state.recent)[: self.window]
        mean, policy = self.estimator(state.parameters, stacked(recent), self._rng(state.iteration), state.policy)
        window_fill = len(recent) / self.window  # terms with n - i <= 0 are zero
        gradient = Parameters(window_fill * mean.theta, window_fill * mean.omega)
        return LocalGradient(gradient, recent[: self.window - 1], policy)

    def consensus_step(self, state: LearnerState, incoming: Mapping[str, Any]) -> LearnerState:
        """A closing round: theta and omega are mixed as at every iteration, and no step is taken."""
        n = state.iteration
        mixed = self.mixer.mix(self.mixer.incoming(state.mixing, n, incoming), n, None)
        return state._replace(iteration=n + 1, mixing=mixed)

    def _rng(self, iteration: int) -> np.random.Generator:
        """A generator of its own for each learner and iteration, so that a restart needs no saved generator."""
        return np.random.default_rng([self.seed, self.index, iteration])
