"""Features of the drone game: Gaussian radial basis functions (RBFs) of places, steps of distances, and effort.

Each is a sum of terms of one drone and of two drones, which the lattice planner needs to know apart:

    r(s, a) = sum_i unary_i(s_i, a_i) + sum_{i<j} pairwise(|p_i - p_j|)
"""

from collections.abc import Iterator
from functools import cached_property
from typing import Protocol

import numpy as np

from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.games.drones.geometry import squared_length
from mabirds_core.games.drones.named_costs import named_costs
from mabirds_core.games.drones.settings import DroneFeatureSettings, DroneSettings
from mabirds_core.games.drones.space import DroneSpace
from mabirds_core.games.interface import Visitation

MOST_EXPONENT = 700.0
"""exp of more overflows; steps are 0 long before."""


class DroneReward(Protocol):
    """A reward of the drone game, or a cost, that a vector of weights or parameters decides."""

    def unary(self, weights: Vector, drone: int, states: Array, actions: Array) -> Array:
        """Terms of one drone.

        Parameters
        ----------
        weights : Vector
            Weights or parameters, shape (K,).
        drone : int
            Index i.
        states : Array
            Of the drone, shape (..., D).
        actions : Array
            Of the drone, shape (..., 2); of a shape that fits.

        Returns
        -------
        Array
            Shape (...).
        """
        ...

    def pairwise(self, weights: Vector, pair: int, distances: Array) -> Array:
        """Terms of two drones.

        Parameters
        ----------
        weights : Vector
            Weights or parameters, shape (K,).
        pair : int
            Index into ``DroneGame.pairs``.
        distances : Array
            Of any shape [m].

        Returns
        -------
        Array
            Shape of ``distances``.
        """
        ...


def total_reward(space: DroneSpace, reward: DroneReward, weights: Vector, states: Array, actions: Array) -> Vector:
    """r(s, a) of M joint states and actions.

    Parameters
    ----------
    space : DroneSpace
        Of the drones.
    reward : DroneReward
        Terms of one drone and of two.
    weights : Vector
        Of the reward, shape (K,).
    states : Array
        Shape (M, N_E D).
    actions : Array
        Shape (M, 2 N_E).

    Returns
    -------
    Vector
        Shape (M,).
    """
    drones, controls = space.drones(states), space.controls(actions)
    result = np.zeros(len(states))
    for i in range(space.n_experts):
        result += reward.unary(weights, i, drones[:, i], controls[:, i])
    for pair, distances in enumerate(pair_distances(space, states)):
        result += reward.pairwise(weights, pair, distances)
    return result


def pair_distances(space: DroneSpace, states: Array) -> Iterator[Array]:
    """|p_i - p_j| of every pair in turn.

    Parameters
    ----------
    space : DroneSpace
        Of the drones.
    states : Array
        Shape (M, N_E D).

    Yields
    ------
    Array
        Shape (M,) [m].
    """
    places = space.positions(states)
    for i, j in space.pairs:
        yield np.sqrt(squared_length(places[:, i] - places[:, j]))


class RbfGrid:
    """RBFs exp(-|p - c|^2 / 2 width^2) with centres c on a grid of X times Y points over the arena.

    An RBF is a product of one along x and one along y, so that no array of all RBFs at all places is needed.

    Parameters
    ----------
    arena : tuple[float, float]
        Width and depth [m].
    counts : tuple[int, int]
        X and Y.
    width : float
        Of the RBFs [m].
    """

    def __init__(self, arena: tuple[float, float], counts: tuple[int, int], width: float) -> None:
        self.axes = [np.linspace(0, side, count) for side, count in zip(arena, counts, strict=True)]
        self.width = width
        self.size = counts[0] * counts[1]

    @cached_property
    def nodes(self) -> Array:
        """Centres of the RBFs in the order of their weights, shape (X Y, 2) [m]."""
        return np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1).reshape(-1, 2)

    def along(self, places: Array) -> tuple[Array, Array]:
        """The factors along x and y at M places, shapes (M, X) and (M, Y)."""
        x, y = (
            np.exp(-((places[:, axis, None] - nodes) ** 2) / (2 * self.width**2))
            for axis, nodes in enumerate(self.axes)
        )
        return x, y

    def total(self, places: Array, weights: Vector) -> Vector:
        """Sum of every RBF over places.

        Parameters
        ----------
        places : Array
            Shape (M, 2) [m].
        weights : Vector
            Of the places, shape (M,).

        Returns
        -------
        Vector
            Shape (X Y,).
        """
        x, y = self.along(places)
        return np.asarray((x.T * weights) @ y).ravel()

    def values(self, weights: Vector, places: Array) -> Array:
        """Weighted sum of the RBFs at places.

        Parameters
        ----------
        weights : Vector
            Of the RBFs, shape (X Y,).
        places : Array
            Shape (..., 2) [m].

        Returns
        -------
        Array
            Shape (...).
        """
        x, y = self.along(places.reshape(-1, 2))
        values = ((x @ weights.reshape(len(self.axes[0]), -1)) * y).sum(axis=1)
        return np.asarray(values.reshape(places.shape[:-1]))


class DroneCostFeatures:
    """phi: RBFs of each drone's place, steps of each pair's distance, each drone's effort, then the user's own.

    RBFs fade out towards a drone's own goal region, which rewards are to explain: phi_c(p) = rbf_c(p)
    (1 - exp(-|p - goal|^2 / 2 radius^2)). Steps are distance_scale / (1 + exp((d - level) / softness)), for drones that
    are nearer than the level and no others: RBFs of the distance cannot tell many flights at .5 m from a few through
    each other. Effort is (|a| / largest action)^2 times ``effort_scale``.
    """

    def __init__(self, space: DroneSpace, settings: DroneSettings, max_action: float) -> None:
        features = settings.features
        self._space, self._levels = space, np.array(features.distance_levels)
        self._goals = [task.goal_region for task in settings.drones]
        self._distance_scale, self._softness = features.distance_scale, features.distance_softness
        self.grid = RbfGrid(space.sides, space.grid(features.cost_spacing), features.cost_width)
        self._near = self._levels < 2 * (2 * settings.drone_radius)
        self._effort = features.effort_scale / max_action**2
        self._named, self._own_names = named_costs(space, settings.costs), tuple(settings.costs)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """One name per feature, for people."""
        drones = range(1, self._space.n_experts + 1)
        return (
            *(f"drone_{i} near ({x:.2f}, {y:.2f}) m" for i in drones for x, y in self.grid.nodes),
            *(f"drones {i + 1} and {j + 1} within {w:g} m" for i, j in self._space.pairs for w in self._levels),
            *(f"drone_{i} effort" for i in drones),
            *self._own_names,
        )

    @cached_property
    def counts(self) -> Mask:
        """Those of distances below two drones' diameters are, shape (K,): of what hardly any demonstration has."""
        n, pairs = self._space.n_experts, len(self._space.pairs)
        result = np.zeros(len(self.names), dtype=bool)
        result[n * self.grid.size :][: pairs * len(self._levels)] = np.tile(self._near, pairs)
        return result

    def _parts(self, weights: Vector) -> tuple[Array, Array, Vector, Vector]:
        """Weights of places (N_E, X Y), of distances (pairs, levels), of effort (N_E,) and of the user's own (J,)."""
        n, pairs = self._space.n_experts, len(self._space.pairs)
        sizes = [n * self.grid.size, pairs * len(self._levels), n]
        places, distances, effort, named = np.split(weights, np.cumsum(sizes))
        return places.reshape(n, -1), distances.reshape(pairs, len(self._levels)), effort, named

    def _fade(self, drone: int, places: Array) -> Vector:
        goal = self._goals[drone]
        return np.asarray(1 - np.exp(-goal.away(places) / (2 * goal.radius**2)))

    def _steps(self, distances: Array) -> Array:
        """scale / (1 + exp((d - level) / softness)), shape (*distances.shape, levels)."""
        beyond = (distances[..., None] - self._levels) / self._softness
        return np.asarray(self._distance_scale / (1 + np.exp(np.minimum(beyond, MOST_EXPONENT))))

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] phi(states[k], actions[k]), shape (K,)."""
        space, (states, actions, weights) = self._space, visitation
        places, controls = space.positions(states), space.controls(actions)
        return np.concatenate(
            [
                *(self.grid.total(places[:, i], weights * self._fade(i, places[:, i])) for i in range(space.n_experts)),
                *(weights @ self._steps(distances) for distances in pair_distances(space, states)),
                weights @ squared_length(controls) * self._effort,
                self._total_of_named(visitation),
            ]
        )

    def _total_of_named(self, visitation: Visitation) -> Vector:
        """Sums of the user's own, shape (J,)."""
        space, (states, actions, weights) = self._space, visitation
        drones, controls = np.moveaxis(space.drones(states), 1, 0), np.moveaxis(space.controls(actions), 1, 0)
        distances = [*pair_distances(space, states)] if self._named else []
        return np.array(
            [
                sum(float((weights * cost.of_drone(drones[i], controls[i])).sum()) for i in cost.drones)
                + sum(float((weights * cost.of_distance(distances[pair])).sum()) for pair in cost.pairs)
                for cost in self._named
            ],
            dtype=np.float64,
        )

    def unary(self, weights: Vector, drone: int, states: Array, actions: Array) -> Array:
        """Costs of one drone's place and effort, and the user's own of one drone."""
        by_place, _, effort, named = self._parts(weights)
        places = states[..., :2]
        of_place = self.grid.values(by_place[drone], places) * self._fade(drone, places)
        costs = np.asarray(of_place + effort[drone] * self._effort * squared_length(actions))
        for weight, cost in zip(named, self._named, strict=True):
            if drone in cost.drones:
                costs = costs + weight * cost.of_drone(states, actions)
        return costs

    def pairwise(self, weights: Vector, pair: int, distances: Array) -> Array:
        """Costs of a pair's distance, and the user's own of it."""
        _, by_level, _, named = self._parts(weights)
        costs = np.asarray(self._steps(distances) @ by_level[pair])
        for weight, cost in zip(named, self._named, strict=True):
            if pair in cost.pairs:
                costs = costs + weight * cost.of_distance(distances)
        return costs


class DroneRewardFeatures:
    """f: RBFs of each drone's place, wider than those of the costs and also in the goal regions."""

    def __init__(self, space: DroneSpace, settings: DroneFeatureSettings) -> None:
        self._space = space
        self.grid = RbfGrid(space.sides, space.grid(settings.reward_spacing), settings.reward_width)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """One name per feature, for people."""
        drones = range(1, self._space.n_experts + 1)
        return tuple(f"drone_{i} near ({x:.2f}, {y:.2f}) m" for i in drones for x, y in self.grid.nodes)

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] f(states[k], actions[k]), shape (K,)."""
        places = self._space.positions(visitation.states)
        return np.concatenate([self.grid.total(places[:, i], visitation.weights) for i in range(self._space.n_experts)])

    def unary(self, weights: Vector, drone: int, states: Array, actions: Array) -> Array:  # noqa: ARG002 - of places
        """Rewards of one drone's place."""
        return self.grid.values(weights.reshape(self._space.n_experts, -1)[drone], states[..., :2])

    def pairwise(self, weights: Vector, pair: int, distances: Array) -> Array:  # noqa: ARG002 - each drone has its own
        """What the distances of a pair of drones earn: zeros, as no reward feature looks at them."""
        return np.zeros(distances.shape)
