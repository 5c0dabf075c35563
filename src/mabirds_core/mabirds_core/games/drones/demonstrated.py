"""How likely what was demonstrated is under a policy on a lattice.

A demonstrated flight goes from place to place. It is followed on the lattice: from where the lattice's flight is, each
drone goes to the node within reach that is nearest to the place shown next; where that is in the drone's goal region,
to the nearest node of the goal region if one is within reach. The sum of log pi_t/mu over the steps until all drones
are shown to have arrived says how many nats likelier than to the uniform policy the flight is to this one.
"""

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.drones.drone_nodes import DroneNodes
from mabirds_core.games.drones.lattice import LatticePolicy
from mabirds_core.games.interface import Trajectories

NOT_HOME = 1e6
"""Square metres that are added where a node outside the goal region would stand for a place in it."""


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
    game, states = policy.game, demonstrations.states
    shown = np.concatenate([states[:, 1:], game.step(states[:, -1:], demonstrations.actions[:, -1:])], axis=1)
    here, total = states[:, 0], np.zeros(len(states))
    for step in range(game.horizon + 1):
        choices, places = policy.choices(step, here), game.positions(shown[:, step])
        nodes = [_nearest(of.nodes, choices.nodes[i], places[:, i]) for i, of in enumerate(policy.drones)]
        under_way = ~game.arrived(states[:, step]).all(axis=-1)
        total += np.where(under_way, choices.log_ratios(nodes), 0.0)
        here = np.concatenate([of.nodes.places[at] for of, at in zip(policy.drones, nodes, strict=True)], axis=1)
    return total


def _nearest(drone: DroneNodes, nodes: Indices, places: Array) -> Indices:
    """Of the nodes (M, A) where moves lead, those that stand for places (M, 2)."""
    there = drone.places[nodes]
    away = ((there - places[:, None]) ** 2).sum(axis=-1)
    away += NOT_HOME * (drone.arrived(places)[:, None] & ~drone.arrived(there))
    away[nodes < 0] = np.inf
    return np.asarray(np.take_along_axis(nodes, away.argmin(axis=1)[:, None], axis=1)[:, 0])
