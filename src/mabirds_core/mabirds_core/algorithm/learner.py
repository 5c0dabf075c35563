"""Algorithm 1: one learner's online iteration (paper, section 4).

At iteration n learner v holds theta, omega and
  1. finds the constrained soft Bellman policy pi(omega, theta),
  2. draws m trajectories zeta^j from it (or takes their expectation),
  3. has received theta_u, omega_u of iteration n from its neighbours, and its demonstration zeta(n),
  4. omega <- sum_u W(n)[v,u] omega_u - alpha(n)/l sum_{i<l} ( mean_j mu(zeta^j)     - mu(zeta(n-i)) )
     theta <- sum_u W(n)[v,u] theta_u - beta(n)/l  sum_{i<l} ( mean_j grad J(zeta^j) - grad J(zeta(n-i)) )
with alpha(n) = abar / n^eta1, beta(n) = bbar / n^eta2; terms with n - i <= 0 are zero. That is the paper's step rule;
``adaptive_steps`` is the default, and ``memory`` has the mean of all demonstrations beside the window of l.

Step 4 is a mixer's: strict as written here, or by push-sum. This one function serves the in-process network and the
ROS nodes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from mabirds_core.algorithm.gradient import GradientEstimate, GradientEstimator
from mabirds_core.algorithm.memory import Memory
from mabirds_core.algorithm.parameters import Parameters, descend
from mabirds_core.algorithm.steps import RuleState, StepRule
from mabirds_core.consensus.mixer import AnyMixer, MixerState
from mabirds_core.games.interface import ConstrainedMarkovGame, ShownFeatures, Trajectories
from mabirds_core.planners.interface import Policy
from mabirds_core.rewards.shown import RewardWithShown


class LearnerState(NamedTuple):
    """A learner before its update n.

    Attributes
    ----------
    iteration : int
        n.
    mixing : MixerState
        What its mixer knows, theta(n) and omega(n) among it.
    memory : Memory
        What it keeps of its demonstrations before zeta(n).
    rule : RuleState
        What its step rule remembers.
    policy : Policy or None
        The policy of iteration n - 1, from which the planner starts at n.
    """

    iteration: int
    mixing: MixerState
    memory: Memory
    rule: RuleState
    policy: Policy | None = None

    @property
    def parameters(self) -> Parameters:
        """theta(n), omega(n)."""
        return self.mixing.parameters


class LocalGradient(NamedTuple):
    """The gradient of G at theta(n), omega(n) for what was demonstrated, and the memory with zeta(n)."""

    estimate: GradientEstimate
    memory: Memory


class StepResult(NamedTuple):
    """The state of iteration n + 1 and the gradient of G that led there."""

    state: LearnerState
    estimate: GradientEstimate

    @property
    def gradient(self) -> Parameters:
        """grad_theta, grad_omega."""
        return self.estimate.gradient


@dataclass(frozen=True)
class Learner:
    """Learner v of the network: everything that does not change over the iterations."""

    index: int
    estimator: GradientEstimator
    mixer: AnyMixer
    steps: StepRule
    memory: Memory
    """That of iteration 1, which is empty."""
    seed: int

    @property
    def game(self) -> ConstrainedMarkovGame:
        """The game that it watches."""
        return self.estimator.game

    def initial_state(self) -> LearnerState:
        """Iteration 1: theta(1) of the reward model, the same for every learner; omega(1) = 0."""
        parameters = self.estimator.initial_parameters(self.seed)
        return LearnerState(1, self.mixer.initial(parameters), self.memory, self.steps.initial(parameters))

    def step(self, state: LearnerState, demonstration: Trajectories, incoming: Mapping[str, Any]) -> StepResult:
        """Iteration n, all four steps.

        Parameters
        ----------
        state : LearnerState
            Before update n.
        demonstration : Trajectories
            zeta(n).
        incoming : Mapping[str, Any]
            What in-neighbours of E(n) have sent, by their names, for the mixer.

        Returns
        -------
        StepResult
            The state of iteration n + 1, and what led there.
        """
        return self.mixed(state, self.local_gradient(state, demonstration), incoming)

    def mixed(self, state: LearnerState, local: LocalGradient, incoming: Mapping[str, Any]) -> StepResult:
        """Step 4, once steps 1 to 3 are made.

        Parameters
        ----------
        state : LearnerState
            Before update n.
        local : LocalGradient
            Of this state.
        incoming : Mapping[str, Any]
            What in-neighbours of E(n) have sent, by their names, for the mixer.

        Returns
        -------
        StepResult
            The state of iteration n + 1, and what led there.
        """
        (estimate, memory), n = local, state.iteration
        step, rule = self.steps.step(state.rule, estimate, n)
        step = self._told(step, state.memory, memory)
        mixed = self.mixer.mix(self.mixer.incoming(state.mixing, n, incoming), n, partial(descend, step=step, n=n))
        # Kept only by planners that start from it, as after a restart: two policies at once are most of the memory.
        previous = estimate.policy if self.estimator.planner.state_dict(estimate.policy) else None
        return StepResult(LearnerState(n + 1, mixed, memory, rule, previous), estimate)

    def local_gradient(self, state: LearnerState, demonstration: Trajectories) -> LocalGradient:
        """Steps 1 to 3, the part of an iteration that needs nobody else.

        Parameters
        ----------
        state : LearnerState
            Before update n.
        demonstration : Trajectories
            zeta(n).

        Returns
        -------
        LocalGradient
            Of (1/l) sum_{i<l} ( mean_j grad J(zeta^j) - grad J(zeta(n-i)) ) in theta, and the same of mu in omega.
        """
        memory = state.memory.add(demonstration)
        # Of its own for each learner and iteration, so that a restart needs no saved generator.
        rng = self.estimator.generator(self.seed, self.index, state.iteration)
        estimate = self.estimator(state.parameters, memory, rng, state.policy)
        return LocalGradient(estimate, memory)

    def consensus_step(self, state: LearnerState, incoming: Mapping[str, Any]) -> LearnerState:
        """A closing round: theta and omega are mixed as at every iteration, and no step is taken.

        Parameters
        ----------
        state : LearnerState
            Before the round n.
        incoming : Mapping[str, Any]
            What in-neighbours of E(n) have sent, by their names.

        Returns
        -------
        LearnerState
            After it.
        """
        n = state.iteration
        mixed = self.mixer.mix(self.mixer.incoming(state.mixing, n, incoming), n, None)
        return state._replace(iteration=n + 1, mixing=mixed)

    def shown(self, state: LearnerState) -> ShownFeatures | None:
        """What demonstrations have shown of cost features, as far as this learner knows.

        Parameters
        ----------
        state : LearnerState
            Before update n.

        Returns
        -------
        ShownFeatures or None
            By those of all learners, who have had n - 1 each, where theta says what they showed; else by its own, and
            None where it has forgotten some.
        """
        own, reward = state.memory.shown, self.estimator.reward
        if own is None or not isinstance(reward, RewardWithShown):
            return own
        return reward.shown(state.parameters.theta, own.demonstrations * len(self.mixer.schedule.learners))

    def _told(self, step: Parameters, before: Memory, after: Memory) -> Parameters:
        """The step, with word of what the newest demonstration showed for the first time where theta carries that."""
        reward, known, now = self.estimator.reward, before.shown, after.shown
        if not isinstance(reward, RewardWithShown) or known is None or now is None:
            return step
        news = now.used & ~known.used
        return step._replace(theta=reward.told(step.theta, news)) if news.any() else step
