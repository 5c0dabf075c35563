"""What a central method is: one learner that is given the demonstrations of all streams."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.memory import Memory
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.steps import RuleState, StepRule
from mabirds_core.games.interface import Trajectories
from mabirds_core.planners.interface import Policy
from mabirds_core.rewards.models import RewardModel


class Cost(NamedTuple):
    """What a method has done since it began."""

    gradient_steps: int = 0
    policy_solves: int = 0

    def more(self, gradient_steps: int, policy_solves: int) -> "Cost":
        """Add to the cost.

        Parameters
        ----------
        gradient_steps : int
            Made since.
        policy_solves : int
            Made since.

        Returns
        -------
        Cost
            The sum.
        """
        return Cost(self.gradient_steps + gradient_steps, self.policy_solves + policy_solves)


class CentralState(NamedTuple):
    """A method before its update n.

    Attributes
    ----------
    iteration : int
        n.
    parameters : Parameters
        theta(n), omega(n).
    memory : Any
        What the method keeps of the demonstrations, each set with one row per stream.
    rule : RuleState
        What its step rule remembers.
    policy : Policy or None
        The last one, from which the planner starts next.
    work : Cost
        All work since the beginning.
    """

    iteration: int
    parameters: Parameters
    memory: Any
    rule: RuleState = {}  # noqa: RUF012 - never changed
    policy: Policy | None = None
    work: Cost = Cost()


class CentralMethod(Protocol):
    """One of the methods; its settings are its attributes."""

    def initial_state(self) -> CentralState:
        """The state before the first demonstration."""
        ...

    def update(self, state: CentralState, demonstrations: Trajectories) -> CentralState:
        """Online iteration n.

        Parameters
        ----------
        state : CentralState
            Before it.
        demonstrations : Trajectories
            Of iteration n, one row per stream.

        Returns
        -------
        CentralState
            Before iteration n + 1.
        """
        ...


def first_state(estimator: GradientEstimator, steps: StepRule, memory: Memory, seed: int) -> CentralState:
    """Iteration 1 with the parameters that learners of the network begin with.

    Parameters
    ----------
    estimator : GradientEstimator
        Which knows theta(1) and omega(1).
    steps : StepRule
        The step rule.
    memory : Memory
        Empty.
    seed : int
        Of theta(1).

    Returns
    -------
    CentralState
        Before the first demonstration.
    """
    parameters = estimator.initial_parameters(seed)
    return CentralState(1, parameters, memory, steps.initial(parameters))


@dataclass(frozen=True)
class MethodParts:
    """What a method is made of: the experiment's game, and the settings of its algorithm."""

    game: Any
    reward: RewardModel
    """r_theta as learners have it."""
    estimator: Callable[[RewardModel], GradientEstimator]
    """How learners estimate gradients, for a reward model."""
    steps: StepRule
    memory: Callable[[RewardModel], Memory]
    """The algorithm's empty memory, for a reward model."""
    seed: int
