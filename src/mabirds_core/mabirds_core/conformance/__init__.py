"""Checks for games, rewards, costs, planners, methods and mixers from anywhere: what Algorithm 1 takes for granted.

Run them in the tests of your own package, on small instances:

    from mabirds_core import conformance
    def test_my_game(): conformance.check_game(MyGame(settings))

Each raises AssertionError that says what is expected of whom. They are slow and obvious on purpose.
"""

from mabirds_core.conformance.games import check_game
from mabirds_core.conformance.methods import check_method, check_mixers, complete_schedule
from mabirds_core.conformance.models import check_cost_feature, check_costs, check_planner, check_reward
from mabirds_core.conformance.settings import check_settings

__all__ = [
    "check_cost_feature",
    "check_costs",
    "check_game",
    "check_method",
    "check_mixers",
    "check_planner",
    "check_reward",
    "check_settings",
    "complete_schedule",
]
