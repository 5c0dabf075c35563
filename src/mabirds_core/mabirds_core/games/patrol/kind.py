"""The entry point of the patrol game."""

from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.registry import Kind


def build_patrol(settings: PatrolSettings) -> object:
    """The game of the settings."""
    from mabirds_core.games.patrol.whole_game import WholePatrolGame  # only experiments with it need it

    return WholePatrolGame(settings)


PATROL = Kind(PatrolSettings, build_patrol, form="tabular", default=True)
