"""The entry point of the patrol game."""

from typing import Any

import numpy as np

from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.registry import Kind


def build_patrol(settings: PatrolSettings) -> object:
    """The game of the settings."""
    from mabirds_core.games.patrol.whole_game import WholePatrolGame  # only experiments with it need it

    return WholePatrolGame(settings)


def recorded_patrol(observed: Any) -> dict[str, Any]:
    """What an experiment file says of patrols in the place of agents that were observed."""
    from mabirds_core.games.patrol.recorded import observed_settings

    return observed_settings(observed)


def sample_patrol(rng: np.random.Generator) -> PatrolSettings:
    """A random map with random tasks."""
    from mabirds_core.games.patrol.random_maps import random_patrol  # needs networkx

    return random_patrol(rng)


PATROL = Kind(
    PatrolSettings, build_patrol, form="tabular", default=True, sample=sample_patrol, recorded=recorded_patrol
)
