"""The entry point of the patrol game."""

import numpy as np

from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.registry import Kind


def build_patrol(settings: PatrolSettings) -> object:
    """The game of the settings."""
    from mabirds_core.games.patrol.whole_game import WholePatrolGame  # only experiments with it need it

    return WholePatrolGame(settings)


def sample_patrol(rng: np.random.Generator) -> PatrolSettings:
    """A random map with random tasks."""
    from mabirds_core.games.patrol.random_maps import random_patrol  # needs networkx

    return random_patrol(rng)


PATROL = Kind(PatrolSettings, build_patrol, form="tabular", default=True, sample=sample_patrol)
