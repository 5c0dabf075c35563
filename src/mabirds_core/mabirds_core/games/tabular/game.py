"""What an enumerable game need not say itself: rewards, expectations, experts, the judge, a picture.

A game that can list its joint states and actions (``interface.TabularGame``) inherits it and is a whole game.
"""

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector
from mabirds_core.costs.models import costs_of
from mabirds_core.games.interface import TabularGame, Trajectories, Transitions
from mabirds_core.games.tabular.transitions import Deterministic
from mabirds_core.games.whole_game import Experts, Learned
from mabirds_core.planners.interface import OccupancyEstimator
from mabirds_core.planners.occupancy import ExactOccupancy, SampledOccupancy
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner
from mabirds_core.rewards.models import LinearReward, NeuralReward, TabularRewardModel, TrueReward

if TYPE_CHECKING:  # learners have no experts, and judge when they have learned
    from mabirds_core.games.tabular.constraint_test import NeutralGame
    from mabirds_core.games.tabular.judge import ExactJudge

EXPERT_KINDS = ("optimal", "soft")


class EnumerableGame:
    """Base of tabular games: ``games.whole_game.Game`` for whatever implements ``interface.TabularGame``."""

    expectations = ("exact", "sampled")
    violation_cost = float("inf")

    @property
    def expert_kinds(self) -> tuple[str, ...]:
        """Optimal ones and those of maximum entropy: what ``experts.KINDS`` has."""
        return EXPERT_KINDS

    @property
    def transitions(self: TabularGame) -> Transitions:
        """Every pair leads to its successor."""
        return Deterministic(lambda: self.successor)

    @cached_property
    def judge(self: "NeutralGame") -> "ExactJudge":
        """The judge of policies, by exact rates without sampling."""
        from mabirds_core.games.tabular.judge import ExactJudge

        return ExactJudge(self)

    def neutral_change(self, rewards: Vector, omega: Vector, expected: Vector, feature: int) -> Parameters | None:  # noqa: ARG002
        """The feature costs nothing. Games whose rewards can say what the feature says should know better."""
        costs = np.zeros_like(omega)
        costs[feature] = -omega[feature]
        return Parameters(np.zeros_like(rewards), costs)

    def expectation(self: TabularGame, kind: str, count: int) -> OccupancyEstimator:
        """The occupancy measure, or means over ``count`` rollouts."""
        return ExactOccupancy(self) if kind == "exact" else SampledOccupancy(self, count)

    def linear_reward(self: TabularGame) -> LinearReward:
        """theta^T f."""
        return LinearReward(self.reward_features)

    def neural_reward(self: TabularGame, hidden: int, bound: float) -> NeuralReward:
        """A network that makes the weights of the linear features."""
        return NeuralReward(self.reward_features, hidden, bound, self.n_experts)

    def true_reward(self: TabularGame) -> TrueReward:
        """The task reward; theta is empty."""
        return TrueReward(self)

    def evaluation_planner(self: TabularGame, planner: Any, reward: TabularRewardModel) -> SoftBellmanPlanner:  # noqa: ARG002
        """The exact one, whichever learned."""
        return SoftBellmanPlanner(self, reward, costs_of(self))

    def judging_planners(self, planner: Any, reward: Any) -> Mapping[str, Any]:  # noqa: ARG002
        """No others: the evaluation planner is exact."""
        return {}

    def experts(self: TabularGame, kind: str, side: str) -> Experts:  # noqa: ARG002 - all ways are known to them
        """Optimal ones, or those of maximum entropy."""
        from mabirds_core.games.tabular.experts import KINDS, TabularExperts

        return TabularExperts(KINDS[kind](self))

    def measures(self, omega: Vector, demonstrations: Trajectories) -> Mapping[str, Mapping[str, float]]:  # noqa: ARG002
        """Nothing that rates and constraint errors do not say."""
        return {}

    def figure(self: TabularGame, learned: Mapping[str, Learned], threshold: float, seed: int) -> Any:  # noqa: ARG002
        """What the dearest features were learned to cost."""
        from mabirds_core.games.tabular.pictures import costs_figure  # matplotlib is for reports

        return costs_figure(self, learned, threshold)

    def demonstrations_figure(self, demonstrations: Trajectories) -> Any:  # noqa: ARG002
        """None: where joint states lie, only the game knows."""
        return None
