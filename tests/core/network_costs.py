"""Tiny games with a network as their cost."""

from typing import Any

import numpy as np

from mabirds_core.arrays import Vector
from mabirds_core.costs.kinds import build_network
from mabirds_core.costs.network import NetworkCost
from mabirds_core.costs.settings import NetworkCostSettings
from mabirds_core.games.patrol.game import PatrolGame


def with_network(game: PatrolGame, **settings: Any) -> tuple[PatrolGame, NetworkCost]:
    """The game with a network as its cost."""
    content = {"kind": "network", "width": 4, "bound": 3.0, "apart": 2.0, **settings}
    costs = build_network(NetworkCostSettings.model_validate(content), game)
    game.cost_model = costs  # type: ignore[attr-defined]
    return game, costs


def some_omega(costs: NetworkCost, seed: int = 0, scale: float = 1.0) -> Vector:
    return np.random.default_rng(seed).normal(size=costs.size) * scale
