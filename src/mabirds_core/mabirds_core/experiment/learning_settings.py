"""How an experiment learns, as written in its file: Algorithm 1 and the central methods."""

from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from pydantic import Field, create_model

from mabirds_core.algorithm.gradient import RolloutStart
from mabirds_core.algorithm.parameters import StepSizes
from mabirds_core.planners.settings import SoftValueIterationSettings
from mabirds_core.registry import METHODS, kinds, union
from mabirds_core.rewards.settings import LinearRewardSettings
from mabirds_core.settings import Settings

if TYPE_CHECKING:
    StepRule = StepSizes
    RewardSettings: TypeAlias = Any
    PlannerSettings: TypeAlias = Any
else:
    StepRule = union("mabirds.step_rules")
    RewardSettings = union("mabirds.rewards")
    PlannerSettings = union("mabirds.planners")


class AlgorithmSettings(Settings):
    """Algorithm 1's settings."""

    steps: StepRule
    window: int = Field(1, ge=1, le=1000, description="l: demonstrations in a gradient")
    expectation: Literal["sampled", "exact"] = Field("sampled", description="rollouts, or the occupancy measure")
    rollouts: int = Field(100, ge=1, le=1_000_000, description="m: trajectories per gradient, where sampled")
    rollout_start: RolloutStart = Field("initial", description="roll out from P_0, or where demonstrations began")
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
