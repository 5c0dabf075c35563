"""What a network has learned patrollers to cost each other: by their distance, and how much single places say of it."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mabirds_core.arrays import Vector
from mabirds_core.costs.models import costs_of
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.named_costs import joint_places


class ByDistance(NamedTuple):
    """Numbers of joint states by the distance of the nearest two experts.

    Attributes
    ----------
    apart : Vector
        Distances in rising order [cells], shape (n,).
    mean : Vector
        Means over the joint states at each, shape (n,).
    least : Vector
        The smallest, shape (n,).
    most : Vector
        The largest, shape (n,).
    """

    apart: Vector
    mean: Vector
    least: Vector
    most: Vector


def by_distance(game: PatrolGame, of_states: Vector) -> ByDistance:
    """Sort joint states by the distance of the nearest two experts; without those where it is infinite.

    Parameters
    ----------
    game : PatrolGame
        Of two experts or more.
    of_states : Vector
        Numbers, shape (S,).

    Returns
    -------
    ByDistance
        In rising order.
    """
    distance = joint_places(game.grid, game.settings.layers).quantities["distance"]
    near = np.isfinite(distance)
    apart, where = np.unique(distance[near], return_inverse=True)
    at = [of_states[near][where == k] for k in range(len(apart))]
    return ByDistance(apart, *(np.array([of(own) for own in at]) for of in (np.mean, np.min, np.max)))


def cost_measures(game: PatrolGame, omega: Vector) -> Mapping[str, Mapping[str, float]]:
    """What studies tell of a network's costs; nothing of weights of features.

    Parameters
    ----------
    game : PatrolGame
        With its cost model.
    omega : Vector
        As learned.

    Returns
    -------
    Mapping
        ``learned_cost`` and ``true_cost`` by distance, 0 for the cheapest; ``cost_variance`` over joint states, of
        single places and of what they do not say.
    """
    costs: Any = costs_of(game)
    if game.n_experts == 1 or not hasattr(costs, "of_states"):
        return {}
    of_states = costs.of_states(omega)
    shared = costs.shared_variance(omega)
    return {
        "learned_cost": _told(by_distance(game, of_states)),
        "true_cost": _told(by_distance(game, game.true_cost)),
        "cost_variance": {"of single places": shared, "of both together": float(of_states.var()) - shared},
    }


def _told(costs: ByDistance) -> dict[str, float]:
    return {
        f"{apart:.2f} cells": float(mean - costs.mean.min())
        for apart, mean in zip(costs.apart, costs.mean, strict=True)
    }
