"""Planners of enumerable games as written in an experiment file."""

from typing import Literal

from pydantic import Field

from mabirds_core.errors import ExperimentError
from mabirds_core.games.interface import TabularGame
from mabirds_core.settings import Settings

MAX_STEPS = 100_000_000
"""Steps of all trajectories that are rolled out at once: some gigabytes."""


class SoftValueIterationSettings(Settings):
    """The exact policy, by enumerating the game."""

    kind: Literal["soft_value_iteration"] = "soft_value_iteration"


class SoftQSettings(Settings):
    """A policy learned from episodes, starting from that of the iteration before."""

    kind: Literal["soft_q_learning"]
    episodes: int = Field(200, ge=1, le=1_000_000, description="episodes per sweep")
    sweeps: int = Field(4, ge=1, le=1000, description="sweeps per iteration, each with the newest policy")
    exploration: float = Field(0.2, ge=0, le=1, description="share of actions drawn uniformly")


def check_soft_q(settings: SoftQSettings, game: TabularGame) -> None:
    """Check that the episodes of a sweep fit into memory, and that nothing slips.

    Parameters
    ----------
    settings : SoftQSettings
        Of the planner.
    game : TabularGame
        With its horizon and transitions.

    Raises
    ------
    ExperimentError
        They do not, or some move does.
    """
    if not game.transitions.deterministic:
        raise ExperimentError("algorithm.policy soft_q_learning: moves slip; take soft_value_iteration")
    check_rollouts("policy.episodes", settings.episodes, game.horizon)


def check_rollouts(name: str, count: int, horizon: int) -> None:
    """Check that what is rolled out at once fits into memory.

    Parameters
    ----------
    name : str
        The setting, below ``algorithm``.
    count : int
        How many trajectories.
    horizon : int
        T.

    Raises
    ------
    ExperimentError
        They have more than MAX_STEPS steps.
    """
    most = MAX_STEPS // (horizon + 1)
    if count > most:
        raise ExperimentError(f"algorithm.{name} {count}: expected at most {most} for horizon {horizon}; take fewer")
