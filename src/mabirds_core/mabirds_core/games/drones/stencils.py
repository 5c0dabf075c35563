"""Nodes of a lattice over the arena, the actions of a drone on it, where they lead, and what they earn."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.drones.features import DroneReward
from mabirds_core.games.drones.game import DroneGame

RINGS = ((0.0, 1), (0.5, 8), (1.0, 16))
"""Speeds, as shares of the largest, and how many directions each has."""

RING_BOUNDS = (0.0, 0.25, 0.75, 1.0)
"""The ring of each speed; its share of the disc's area is what its actions weigh together."""


def action_set(speed: float) -> tuple[Array, Vector]:
    """The 25 velocities (25, 2) and their shares of mu (25,)."""
    angles = [2 * np.pi * np.arange(count) / count for _, count in RINGS]
    velocities = [r * np.column_stack([np.cos(a), np.sin(a)]) for (r, _), a in zip(RINGS, angles, strict=True)]
    areas = [outer**2 - inner**2 for inner, outer in pairwise(RING_BOUNDS)]
    shares = [np.full(count, area / count) for (_, count), area in zip(RINGS, areas, strict=True)]
    return speed * np.concatenate(velocities), np.concatenate(shares)


@dataclass(frozen=True)
class Stencil:
    """Where actions from M places lead, on the lattice: the W nodes around each, and the actions' weights of them."""

    nodes: Indices
    """Shape (M, N_E, W)."""
    weights: Array
    """Bilinear weights, shape (M, N_E, A, W); each action's sum to 1."""


@dataclass(frozen=True)
class Lattice:
    """A lattice over the arena of a game of single integrators.

    Attributes
    ----------
    game : DroneGame
        With the arena.
    spacing : float
        Largest distance of two neighbouring nodes [m].
    """

    game: DroneGame
    spacing: float

    @cached_property
    def axes(self) -> list[Array]:
        """x and y of the nodes."""
        counts = self.game.settings.lattice(self.spacing)
        return [np.linspace(0, side, count) for side, count in zip(self.game.settings.arena, counts, strict=True)]

    @cached_property
    def nodes(self) -> Array:
        """Places of the lattice's nodes, shape (S, 2)."""
        return np.asarray(np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1).reshape(-1, 2))

    @cached_property
    def action_set(self) -> tuple[Array, Vector]:
        """Velocities and their shares."""
        return action_set(self.game.settings.max_speed)

    @cached_property
    def everywhere(self) -> Stencil:
        """Where actions from every node lead."""
        return self.stencils(np.repeat(self.nodes[:, None], self.game.n_experts, axis=1))

    @cached_property
    def pair_distances(self) -> Array:
        """Metres between every two nodes, shape (S, S)."""
        x, y = np.moveaxis(self.nodes[:, None] - self.nodes, -1, 0)
        return np.asarray(np.hypot(x, y))

    def stencils(self, places: Array) -> Stencil:
        """For M places of all drones, shape (M, N_E, 2)."""
        velocities, _ = self.action_set
        here = np.repeat(places[:, None], len(velocities), axis=1)
        there = self.game.dynamics.step(here, np.broadcast_to(velocities[:, None], here.shape))
        along = [self._axis_stencil(axis, places[..., axis], there[..., axis]) for axis in (0, 1)]
        (first_x, weights_x), (first_y, weights_y) = along
        nodes = first_x[..., :, None] * len(self.axes[1]) + first_y[..., None, :]
        weights = weights_x[..., :, None] * weights_y[..., None, :]
        flat = np.moveaxis(weights.reshape(*weights.shape[:3], -1), 1, 2)
        return Stencil(nodes.reshape(*nodes.shape[:2], -1), np.ascontiguousarray(flat))

    def _axis_stencil(self, axis: int, here: Array, there: Array) -> tuple[Indices, Array]:
        """Numbers of the nodes around ``here`` (M, N_E), and hat functions of them at ``there`` (M, A, N_E)."""
        count, step = len(self.axes[axis]), self.axes[axis][1]
        width = self.game.settings.stencil_shape(self.spacing)[axis]
        first = np.clip(np.floor(here / step).astype(np.int64) - (width // 2 - 1), 0, count - width)
        numbers = first[..., None] + np.arange(width)
        return numbers, np.maximum(0.0, 1 - np.abs(there[..., None] / step - numbers[:, None]))


def action_rewards(
    lattice: Lattice, rewards: tuple[tuple[DroneReward, Vector], ...], drone: int, states: Array, temperature: float
) -> Array:
    """log mu(a) + r_i(s, a) / tau of one drone.

    Parameters
    ----------
    lattice : Lattice
        With the actions.
    rewards : tuple[tuple[DroneReward, Vector], ...]
        What r is the sum of, each with its parameters.
    drone : int
        Index i.
    states : Array
        Shape (M, 2).
    temperature : float
        tau.

    Returns
    -------
    Array
        Shape (M, A).
    """
    velocities, shares = lattice.action_set
    terms = (reward.unary(weights, drone, states[:, None], velocities) for reward, weights in rewards)
    return np.asarray(np.log(shares) + sum(terms, np.zeros((len(states), 1))) / temperature)
