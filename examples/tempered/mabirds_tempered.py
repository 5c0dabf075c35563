"""Soft value iteration at a temperature: the policy of the reward divided by it, for enumerable games."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field

from mabirds_core.arrays import Array, Vector
from mabirds_core.costs.models import costs_of
from mabirds_core.games.interface import TabularGame, Trajectories
from mabirds_core.planners.interface import Policy
from mabirds_core.planners.soft_bellman import SoftBellmanPolicy, soft_bellman_policy
from mabirds_core.registry import Kind
from mabirds_core.rewards.models import TabularRewardModel
from mabirds_core.settings import Settings


class TemperedSettings(Settings):
    """Soft value iteration of the reward divided by a temperature."""

    kind: Literal["tempered"]
    temperature: float = Field(1.0, gt=0, le=1000, description="tau: the policy is that of the reward divided by it")


@dataclass(frozen=True)
class TemperedPlanner:
    """pi_t(a|s) ~ exp(Q_t(s, a)) with the reward (r_theta + omega^T phi) / tau."""

    game: TabularGame
    reward: TabularRewardModel
    temperature: float

    def plan(
        self,
        theta: Vector,
        omega: Vector,
        previous: Policy | None = None,  # noqa: ARG002 - exact from any start
        rng: np.random.Generator | None = None,  # noqa: ARG002 - nothing is drawn
        observed: Trajectories | None = None,  # noqa: ARG002 - nothing is learned from examples
    ) -> SoftBellmanPolicy:
        """The policy for these parameters."""
        reward = self.reward.table(theta) + costs_of(self.game).table(omega)
        return soft_bellman_policy(self.game, reward / self.temperature)

    def state_dict(self, policy: Policy) -> dict[str, Array]:  # noqa: ARG002 - exact from any start
        """No arrays: the planner is exact from any start."""
        return {}

    def load_state_dict(self, memory: Mapping[str, Array]) -> None:
        """No policy: the planner needs none to start from."""


def build_tempered(settings: TemperedSettings, game: Any, reward: Any) -> TemperedPlanner:
    """The planner of the settings."""
    return TemperedPlanner(game, reward, settings.temperature)


TEMPERED = Kind(TemperedSettings, build_tempered, form="tabular")
