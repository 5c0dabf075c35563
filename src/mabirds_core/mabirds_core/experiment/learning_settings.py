"""How an experiment learns, as written in its file: Algorithm 1 and the central methods."""

from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from pydantic import Field, create_model, field_validator

from mabirds_core.algorithm.adaptive_steps import AdaptiveSteps
from mabirds_core.algorithm.gradient import RolloutStart
from mabirds_core.costs.settings import LinearCostSettings
from mabirds_core.kind_settings import settings_of
from mabirds_core.planners.settings import SoftValueIterationSettings
from mabirds_core.registry import METHODS, kinds
from mabirds_core.rewards.settings import LinearRewardSettings
from mabirds_core.settings import Settings

if TYPE_CHECKING:
    StepRule: TypeAlias = Any
    RewardSettings: TypeAlias = Any
    CostSettings: TypeAlias = Any
    PlannerSettings: TypeAlias = Any
else:
    StepRule = settings_of("mabirds.step_rules")
    RewardSettings = settings_of("mabirds.rewards")
    CostSettings = settings_of("mabirds.costs")
    PlannerSettings = settings_of("mabirds.planners")


MAX_WINDOW = 1000
"""Demonstrations in a window, at most."""


class AlgorithmSettings(Settings):
    """Algorithm 1's settings."""

    steps: StepRule = Field(AdaptiveSteps(), description="the step rule; the default needs no numbers")
    window: int | Literal["all"] = Field("all", description="l: demonstrations in a gradient, or all of them")
    expectation: Literal["sampled", "exact"] | None = Field(
        None, description="rollouts, or the occupancy measure; default: the occupancy measure where the game has it"
    )
    rollouts: int = Field(100, ge=1, le=1_000_000, description="m: trajectories per gradient, where sampled")
    rollout_start: RolloutStart = Field("demonstration", description="roll out from P_0, or where demonstrations began")
    reward: RewardSettings = Field(LinearRewardSettings(), description="the reward model")
    cost: CostSettings = Field(LinearCostSettings(), description="the cost model")
    share_shown: bool = Field(
        True,
        description="tell neighbours, in theta, which cost features were shown, in games with a constraint test; false:"
        " constraints are told by one's own demonstrations",
    )
    policy: PlannerSettings = Field(SoftValueIterationSettings(), description="how the policy is found")

    @field_validator("window")
    @classmethod
    def _window_is_a_length(cls, window: int | str) -> int | str:
        if window != "all" and not 1 <= int(window) <= MAX_WINDOW:
            raise ValueError(f"expected a number from 1 to {MAX_WINDOW}, or all")
        return window


if TYPE_CHECKING:
    BaselineSettings: TypeAlias = Any
else:
    BaselineSettings = create_model(
        "BaselineSettings",
        __base__=Settings,
        __doc__="The central methods that the experiment is compared with.",
        **{name: (kind.settings, kind.settings()) for name, kind in kinds(METHODS).items()},
    )
