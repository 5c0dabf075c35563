"""How likely what was demonstrated is under a policy on a lattice, and under one that flies straight.

A demonstrated flight goes from place to place. It is followed on the lattice: from where the lattice's flight is, each
drone goes to the node within reach that is nearest to the place shown next; where that is in the drone's goal region,
to the nearest node of the goal region if one is within reach. The sum of log pi_t/mu over the steps until all drones
are shown to have arrived says how many nats likelier than to the uniform policy the flight is to this one.

Straight flight with noise is the policy that learns nothing but one number: each drone makes for its goal region,

    pi(a|s)  proportional to  mu(a) exp( -|s' - s*|^2 / 2 sigma^2 ),    s* one step on the straight way to its centre
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Array, Indices, Mask, Vector
from mabirds_core.games.drones.drone_nodes import DroneNodes
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePolicy
from mabirds_core.games.drones.lone_drone import log_shares, log_sum_exp
from mabirds_core.games.interface import Trajectories

NOT_HOME = 1e6
"""Square metres that are added where a node outside the goal region would stand for a place in it."""

NOISES = np.geomspace(0.05, 20.0, 60)
"""sigma that are tried, as multiples of the way of a step."""


class Snapped(NamedTuple):
    """One step of m demonstrations on the lattice.

    Attributes
    ----------
    step : int
        t.
    states : Array
        Joint states, shape (m, 2 N_E).
    moves : list[Indices]
        Nodes where each drone may go, shape (m, A_i).
    nodes : list[Indices]
        Where each drone goes, shape (m,).
    under_way : Mask
        Which demonstrations have drones that have not arrived, shape (m,).
    """

    step: int
    states: Array
    moves: list[Indices]
    nodes: list[Indices]
    under_way: Mask


def snapped(game: DroneGame, drones: list[DroneNodes], demonstrations: Trajectories) -> Iterator[Snapped]:
    """Follow demonstrations on a lattice.

    Parameters
    ----------
    game : DroneGame
        Of single integrators.
    drones : list[DroneNodes]
        The lattice as each drone sees it.
    demonstrations : Trajectories
        m of them, which begin in the squares of P_0.

    Yields
    ------
    Snapped
        t = 0 .. T.
    """
    states = demonstrations.states
    shown = np.concatenate([states[:, 1:], game.step(states[:, -1:], demonstrations.actions[:, -1:])], axis=1)
    here = states[:, 0]
    for step in range(game.horizon + 1):
        now, later = game.positions(here), game.positions(shown[:, step])
        moves = [drone.moves_from(now[:, i]).nodes for i, drone in enumerate(drones)]
        nodes = [_nearest(drone, moves[i], later[:, i]) for i, drone in enumerate(drones)]
        under_way = np.asarray(~game.arrived(states[:, step]).all(axis=-1))
        yield Snapped(step, here, moves, nodes, under_way)
        here = np.concatenate([drone.places[at] for drone, at in zip(drones, nodes, strict=True)], axis=1)


def log_ratios(policy: LatticePolicy, demonstrations: Trajectories) -> Vector:
    """sum_t log pi_t/mu of demonstrations.

    Parameters
    ----------
    policy : LatticePolicy
        Of drones.
    demonstrations : Trajectories
        m of them, which begin in the squares of P_0.

    Returns
    -------
    Vector
        In nats, shape (m,).
    """
    total = np.zeros(len(demonstrations.states))
    for at in snapped(policy.game, [of.nodes for of in policy.drones], demonstrations):
        total += np.where(at.under_way, policy.choices(at.step, at.states).log_ratios(at.nodes), 0.0)
    return total


def straight_log_ratios(policy: LatticePolicy, demonstrations: Trajectories) -> Vector:
    """sum_t log pi/mu of demonstrations, of straight flight with the noise that makes them likeliest.

    Parameters
    ----------
    policy : LatticePolicy
        Whose lattice the demonstrations are followed on.
    demonstrations : Trajectories
        m of them, which begin in the squares of P_0.

    Returns
    -------
    Vector
        In nats, shape (m,).
    """
    game, drones = policy.game, [of.nodes for of in policy.drones]
    steps = list(snapped(game, drones, demonstrations))
    totals = np.zeros((len(NOISES), len(demonstrations.states)))
    for at in steps:
        for i, drone in enumerate(drones):
            places = game.positions(at.states)[:, i]
            totals += np.where(at.under_way, _straight(drone, places, at.moves[i], at.nodes[i]), 0.0)
    return np.asarray(totals[totals.mean(axis=1).argmax()])


def _straight(drone: DroneNodes, places: Array, moves: Indices, nodes: Indices) -> Array:
    """log pi/mu of one drone's moves for each of NOISES, shape (n, M)."""
    reach = drone.game.dynamics.reach
    ways = drone.game.settings.drones[drone.drone].goal_region.nearest(places) - places
    lengths = np.sqrt((ways**2).sum(axis=1, keepdims=True))
    aims = places + ways * np.minimum(1.0, reach / np.maximum(lengths, reach / 2))
    away = ((drone.places[moves] - aims[:, None]) ** 2).sum(axis=-1)
    scores = -away / (2 * (NOISES[:, None, None] * reach) ** 2)
    chosen = (moves == nodes[:, None]).argmax(axis=1)
    return np.asarray(
        scores[:, np.arange(len(places)), chosen] - log_sum_exp(log_shares(drone.moves_from(places).shares) + scores)
    )


def _nearest(drone: DroneNodes, nodes: Indices, places: Array) -> Indices:
    """Of the nodes (M, A) where moves lead, those that stand for places (M, 2)."""
    there = drone.places[nodes]
    away = ((there - places[:, None]) ** 2).sum(axis=-1)
    away += NOT_HOME * (drone.arrived(places)[:, None] & ~drone.arrived(there))
    away[nodes < 0] = np.inf
    return np.asarray(np.take_along_axis(nodes, away.argmin(axis=1)[:, None], axis=1)[:, 0])
