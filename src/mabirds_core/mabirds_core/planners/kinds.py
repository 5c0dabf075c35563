"""The entry points of the planners for enumerable games."""

from mabirds_core.costs.models import costs_of
from mabirds_core.games.interface import TabularGame
from mabirds_core.planners.interface import Planner
from mabirds_core.planners.settings import SoftQSettings, SoftValueIterationSettings, check_soft_q
from mabirds_core.registry import Kind
from mabirds_core.rewards.models import TabularRewardModel


def build_soft_value_iteration(
    settings: SoftValueIterationSettings,  # noqa: ARG001 - there is nothing to set
    game: TabularGame,
    reward: TabularRewardModel,
) -> Planner:
    """Build the exact planner.

    Parameters
    ----------
    settings : SoftValueIterationSettings
        There is nothing to set.
    game : TabularGame
        Is enumerated.
    reward : TabularRewardModel
        r_theta.

    Returns
    -------
    Planner
        A ``SoftBellmanPlanner``.
    """
    from mabirds_core.planners.soft_bellman import SoftBellmanPlanner

    return SoftBellmanPlanner(game, reward, costs_of(game))


def build_soft_q(settings: SoftQSettings, game: TabularGame, reward: TabularRewardModel) -> Planner:
    """Build the planner that learns from episodes.

    Parameters
    ----------
    settings : SoftQSettings
        Of the episodes.
    game : TabularGame
        Is sampled.
    reward : TabularRewardModel
        r_theta.

    Returns
    -------
    Planner
        A ``SoftQPlanner``.
    """
    from mabirds_core.planners.soft_q_learning import SoftQPlanner

    return SoftQPlanner(game, reward, costs_of(game), **settings.model_dump(exclude={"kind"}))


SOFT_VALUE_ITERATION = Kind(SoftValueIterationSettings, build_soft_value_iteration, form="tabular")
SOFT_Q_LEARNING = Kind(SoftQSettings, build_soft_q, form="tabular", check=check_soft_q)
