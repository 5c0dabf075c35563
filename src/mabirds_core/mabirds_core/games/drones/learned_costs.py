"""What learned cost weights omega mean: the cost -omega^T phi of places, ways and distances, in units of reward."""

from collections.abc import Mapping

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.interface import Trajectories

POINTS = 2000
"""Points of a disc over which a mean is taken."""

RIM_POINTS = 360

FAR = 1.0
"""A distance that is no matter [m]."""


def place_costs(game: DroneGame, omega: Vector, drone: int, places: Array) -> Array:
    """Learned costs of places of a drone that makes no effort.

    Parameters
    ----------
    game : DroneGame
        With the cost features.
    omega : Vector
        Cost weights, shape (K,).
    drone : int
        Index.
    places : Array
        Shape (..., 2) [m].

    Returns
    -------
    Array
        Shape (...).
    """
    states = np.zeros((places[..., 0].size, game.dynamics.drone_size))
    states[:, :2] = places.reshape(-1, 2)
    costs = -game.cost_features.unary(omega, drone, states, np.zeros((len(states), 2)))
    return np.asarray(costs.reshape(places.shape[:-1]))


def distance_costs(game: DroneGame, omega: Vector, pair: int, distances: Array) -> Array:
    """Learned costs of the distances of two drones.

    Parameters
    ----------
    game : DroneGame
        With the cost features.
    omega : Vector
        Cost weights, shape (K,).
    pair : int
        Index into ``game.pairs``.
    distances : Array
        Of any shape [m].

    Returns
    -------
    Array
        Shape of ``distances``.
    """
    return np.asarray(-game.cost_features.pairwise(omega, pair, distances))


def obstacle_costs(game: DroneGame, omega: Vector) -> tuple[Array, Array]:
    """Mean costs of obstacles.

    Parameters
    ----------
    game : DroneGame
        With the obstacles.
    omega : Vector
        Cost weights, shape (K,).

    Returns
    -------
    inside : Array
        Of where a drone's middle would touch each obstacle, shape (N_E, obstacles).
    border : Array
        Of that disc's rim, shape (N_E, obstacles).
    """
    keep = game.settings.drone_radius
    barriers = game.settings.barriers
    shapes = (
        np.array([barrier.places(keep, POINTS) for barrier in barriers]).reshape(-1, POINTS, 2),
        np.array([barrier.outline(keep, RIM_POINTS) for barrier in barriers]).reshape(-1, RIM_POINTS, 2),
    )
    inside, border = (
        np.stack([_means_in_arena(game, omega, drone, places) for drone in range(game.n_experts)]) for places in shapes
    )
    return inside, border


def _means_in_arena(game: DroneGame, omega: Vector, drone: int, places: Array) -> Array:
    """Mean cost of each obstacle's places (obstacles, n, 2) that are in the arena; 0 where none is."""
    reachable = ((places >= 0) & (places <= game.arena)).all(axis=-1)
    costs = np.where(reachable, place_costs(game, omega, drone, places), 0.0)
    return np.asarray(costs.sum(axis=1) / np.maximum(1, reachable.sum(axis=1)))


def trajectory_costs(game: DroneGame, omega: Vector, trajectories: Trajectories) -> Vector:
    """Mean cost of where each drone is as long as it is under way.

    Parameters
    ----------
    game : DroneGame
        With the cost features.
    omega : Vector
        Cost weights, shape (K,).
    trajectories : Trajectories
        At least one.

    Returns
    -------
    Vector
        Shape (N_E,).
    """
    places, under_way = game.positions(trajectories.states), ~game.arrived(trajectories.states)
    by_drone = [
        place_costs(game, omega, drone, places[..., drone, :][under_way[..., drone]]).mean()
        for drone in range(game.n_experts)
    ]
    return np.array(by_drone)


def closeness_costs(game: DroneGame, omega: Vector) -> Vector:
    """By how much the cheapest distance from 0 to the least distance costs more than ``FAR`` does.

    Parameters
    ----------
    game : DroneGame
        With the least distance.
    omega : Vector
        Cost weights, shape (K,).

    Returns
    -------
    Vector
        Shape (pairs,).
    """
    close = np.linspace(0.0, game.settings.least_distance, 101)
    dearer = [
        distance_costs(game, omega, pair, close).min() - distance_costs(game, omega, pair, np.array(FAR))
        for pair in range(len(game.pairs))
    ]
    return np.array(dearer)


def measures(game: DroneGame, omega: Vector, demonstrations: Trajectories) -> Mapping[str, Mapping[str, float]]:
    """What obstacles and closeness are learned to cost, and whether that is dear.

    Parameters
    ----------
    game : DroneGame
        Whose places and distances cost something.
    omega : Vector
        Learned cost weights, shape (K,).
    demonstrations : Trajectories
        Of all learners.

    Returns
    -------
    Mapping
        ``obstacle_cost`` and ``rim_cost``: mean cost of where a drone would touch an obstacle, and of that disc's rim;
        ``demonstrated_cost``: of where that drone was shown; ``obstacle_dearer``: 1 where both cost more than that,
        else 0; ``closeness_cost``: by how much distances below the least cost more than ``FAR``; ``closeness_dearer``:
        1 where that is more than 0.
    """
    inside, border = obstacle_costs(game, omega)
    shown = np.broadcast_to(trajectory_costs(game, omega, demonstrations)[:, None], inside.shape)
    by_obstacle = {
        "obstacle_cost": inside,
        "rim_cost": border,
        "demonstrated_cost": shown,
        "obstacle_dearer": np.minimum(inside, border) > shown,
    }
    closeness, barriers = closeness_costs(game, omega), game.settings.barriers
    by_pair = {"closeness_cost": closeness, "closeness_dearer": closeness > 0}
    places = [" to ".join("({:g}, {:g})".format(*end) for end in dict.fromkeys(of.ends)) + " m" for of in barriers]
    obstacles = [f"{place}, drone {drone + 1}" for place in places for drone in range(game.n_experts)]
    pairs = [f"drones {first + 1} and {second + 1}" for first, second in game.pairs]
    return {
        **{
            name: dict(zip(obstacles, map(float, values.T.ravel()), strict=True))
            for name, values in by_obstacle.items()
        },
        **{name: dict(zip(pairs, map(float, values), strict=True)) for name, values in by_pair.items()},
    }
