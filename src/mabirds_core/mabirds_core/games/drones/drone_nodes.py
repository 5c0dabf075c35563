"""The lattice as one drone sees it: its goal region absorbs, and nodes are numbered in the order of their reach.

A drone that starts in its square of P_0 can be at n_t of the nodes at step t. As staying is a move, these are among
the n_{t+1} of the next step. Numbered by the first step at which they can be reached, they are 0 .. n_t - 1: tables of
what drones may meet at step t are corners of tables of all nodes.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mabirds_core.arrays import Array, Indices, Mask, Vector
from mabirds_core.games.drones.features import DroneReward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.geometry import squared_length
from mabirds_core.games.drones.nodes import SAME_PLACE, Moves, NodeLattice

Rewards = tuple[tuple[DroneReward, Vector], ...]
"""What r is the sum of, each with its parameters."""


@dataclass(frozen=True)
class DroneNodes:
    """Nodes and moves of one drone.

    Attributes
    ----------
    game : DroneGame
        Of single integrators.
    lattice : NodeLattice
        Over its arena.
    drone : int
        Index i.
    """

    game: DroneGame
    lattice: NodeLattice
    drone: int

    @property
    def size(self) -> int:
        """S, how many nodes there are."""
        return len(self.places)

    @cached_property
    def places(self) -> Array:
        """Of the nodes, shape (S, 2) [m]."""
        return self.lattice.places[self._order]

    @cached_property
    def coordinates(self) -> Indices:
        """k_1 and k_2 of the nodes, shape (S, 2)."""
        return self.lattice.coordinates[self._order]

    @cached_property
    def reached(self) -> Indices:
        """n_t: how many nodes the drone can have reached at t = 1 .. T + 1, shape (T + 1,)."""
        steps = np.sort(self._first_steps)
        return np.searchsorted(steps, np.arange(1, self.game.horizon + 2), side="right")

    @cached_property
    def moves(self) -> Moves:
        """At every node."""
        nodes, shares = self.lattice.moves
        return self._absorbed(Moves(self._numbers[nodes[self._order]], shares[self._order]), self.places)

    def numbers_at(self, places: Array) -> Indices:
        """Numbers of the nodes that places (M, 2) are, shape (M,); -1 for those between nodes."""
        nodes, distances = self.lattice.nearest(places)
        return np.where(distances <= SAME_PLACE, self._numbers[nodes], -1)

    def moves_from(self, places: Array, here: Indices | None = None) -> Moves:
        """What the drone can do at any places.

        Parameters
        ----------
        places : Array
            Shape (M, 2) [m].
        here : Indices, optional
            ``numbers_at`` them, where they are known.

        Returns
        -------
        Moves
            To the nodes within reach. In the goal region it is to stay: at the node that is the place or, for places
            between nodes, at the nearest node, which stands for the place.
        """
        here = self.numbers_at(places) if here is None else here
        away = here < 0
        if not away.any():
            return self.moves.at(here)
        free = self.lattice.moves_from(places[away])
        free = self._absorbed(Moves(self._numbers[free.nodes], free.shares), places[away])
        width = max(self.moves.nodes.shape[1], free.nodes.shape[1])
        merged = Moves(np.full((len(places), width), -1), np.zeros((len(places), width)))
        for rows, part in ((away, free), (~away, self.moves.at(here[~away]))):
            for table, values in zip(merged, part, strict=True):
                table[rows, : values.shape[1]] = values
        return merged

    def nearest(self, places: Array) -> Indices:
        """Numbers of the nodes that are nearest to places (M, 2), shape (M,)."""
        return self._numbers[self.lattice.nearest(places)[0]]

    def velocities(self, places: Array, nodes: Indices) -> Array:
        """Which lead from places to nodes; zero in the goal region.

        Parameters
        ----------
        places : Array
            Shape (M, 2) [m].
        nodes : Indices
            Shape (M, A).

        Returns
        -------
        Array
            Shape (M, A, 2) [m/s].
        """
        ways = (self.places[nodes] - places[:, None]) / self.game.dynamics.time_step
        return np.where(self.arrived(places)[:, None, None], 0.0, ways)

    def rewards(self, rewards: Rewards, places: Array, nodes: Indices) -> Array:
        """r_i of moves.

        Parameters
        ----------
        rewards : Rewards
            What r is the sum of.
        places : Array
            Shape (M, 2) [m].
        nodes : Indices
            Where the moves lead, shape (M, A).

        Returns
        -------
        Array
            Shape (M, A).
        """
        velocities = self.velocities(places, nodes)
        terms = (reward.unary(weights, self.drone, places[:, None], velocities) for reward, weights in rewards)
        return np.asarray(sum(terms, np.zeros(nodes.shape)))

    def arrived(self, places: Array) -> Mask:
        """Which places (M, 2) are in the goal region, shape (M,)."""
        goal = self.game.settings.drones[self.drone].goal_region
        return np.asarray(goal.away(places) <= goal.radius**2)

    def _absorbed(self, moves: Moves, places: Array) -> Moves:
        """The moves, but for places in the goal region to stay alone."""
        arrived = self.arrived(places)
        stay = np.arange(moves.nodes.shape[1]) == 0
        nodes = np.where(arrived[:, None], np.where(stay, self.nearest(places)[:, None], -1), moves.nodes)
        return Moves(nodes, np.where(arrived[:, None], stay, moves.shares))

    @cached_property
    def _first_steps(self) -> Indices:
        """First step at which the drone can be at each node of the lattice, shape (S,); T + 2: none."""
        never = self.game.horizon + 2
        steps = np.where(self._within_reach_of_starts(), 1, never)
        targets, goal = self.lattice.moves.nodes, self.arrived(self.lattice.places)
        for step in range(2, never):
            after = targets[(steps == step - 1) & ~goal]
            new = after[after >= 0]
            steps[new] = np.minimum(steps[new], step)
        return steps

    def _within_reach_of_starts(self) -> Mask:
        """Which nodes may be reached from the square of P_0 in a step."""
        task, places = self.game.settings.drones[self.drone], self.lattice.places
        low, high = task.start_corners
        away = places - np.clip(places, low, high)
        return np.asarray(np.sqrt(squared_length(away)) <= self.lattice.reach + SAME_PLACE)

    @cached_property
    def _order(self) -> Indices:
        return np.argsort(self._first_steps, kind="stable")

    @cached_property
    def _numbers(self) -> Indices:
        """By number in the lattice: that of this drone; the last one stands for -1."""
        numbers = np.full(len(self._order) + 1, -1)
        numbers[self._order] = np.arange(len(self._order))
        return numbers


def pair_rewards(
    first: DroneNodes, second: DroneNodes, rewards: Rewards, at: tuple[Indices, Indices]
) -> NDArray[np.float32]:
    """r_12 of nodes.

    Distances depend on differences of coordinates alone, of which there are few.

    Parameters
    ----------
    first : DroneNodes
        Of a drone.
    second : DroneNodes
        Of another one, on the same lattice.
    rewards : Rewards
        What r is the sum of.
    at : tuple[Indices, Indices]
        Nodes of the first and of the second drone, of shapes that fit.

    Returns
    -------
    NDArray[np.float32]
        Of the shape of both.
    """
    most = first.coordinates.max(axis=0)
    k = np.stack(np.meshgrid(*(np.arange(-n, n + 1) for n in most), indexing="ij"), axis=-1)
    distances = first.lattice.lengths(k)
    values = sum((reward.pairwise(w, 0, distances) for reward, w in rewards), np.zeros(distances.shape))
    flat = np.asarray(values, dtype=np.float32).ravel()
    rows, columns = ((of.coordinates @ np.array([2 * most[1] + 1, 1])).astype(np.int32) for of in (first, second))
    return np.asarray(flat[rows[at[0]] - columns[at[1]] + np.int32(flat.size // 2)])
