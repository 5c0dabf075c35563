"""How an experiment learns, as written in its file: Algorithm 1 and the central methods."""

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import Field, create_model

from mabirds_core.algorithm.adaptive_steps import AdaptiveSteps
from mabirds_core.algorithm.gradient import RolloutStart
from mabirds_core.planners.settings import SoftValueIterationSettings
from mabirds_core.registry import METHODS, kinds, union
from mabirds_core.rewards.settings import LinearRewardSettings
from mabirds_core.settings import Settings

if TYPE_CHECKING:
    StepRule: TypeAlias = Any
    RewardSettings: TypeAlias = Any
    PlannerSettings: TypeAlias = Any
else:
    StepRule = union("mabirds.step_rules")
    RewardSettings = union("mabirds.rewards")
    PlannerSettings = union("mabirds.planners")


Window = Annotated[int, Field(ge=1, le=1000)] | Literal["all"]
"""l, or all demonstrations."""


class AlgorithmSettings(Settings):
    """Algorithm 1's settings."""

    steps: StepRule = Field(AdaptiveSteps(), description="the step rule; the default needs no numbers")
    window: Window = Field("all", description="l: demonstrations in a gradient, or all of them")
    expectation: Literal["sampled", "exact"] | None = Field(
        None, description="rollouts, or the occupancy measure; default: the occupancy measure where the game has it"
    )
    rollouts: int = Field(100, ge=1, le=1_000_000, description="m: trajectories per gradient, where sampled")
    rollout_start: RolloutStart = Field("demonstration", description="roll out from P_0, or where demonstrations began")
    reward: RewardSettings = Field(LinearRewardSettings(), description="the reward model")
    policy: PlannerSettings = Field(SoftValueIterationSettings(), description="how the policy is found")


if TYPE_CHECKING:
    BaselineSettings: TypeAlias = Any
else:
    BaselineSettings = create_model(
        "BaselineSettings",
        __base__=Settings,
        __doc__="The central methods that the experiment is compared with.",
        **{name: (kind.settings, kind.settings()) for name, kind in kinds(METHODS).items()},
    )
