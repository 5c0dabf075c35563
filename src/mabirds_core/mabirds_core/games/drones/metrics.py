"""How well drones fly, and by how much policies differ: over their rollouts."""

from collections.abc import Sequence

import numpy as np

from mabirds_core.arrays import Array, weighted_counts
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.judging import ImitationMetrics


def drone_imitation(game: DroneGame, trajectories: Trajectories) -> ImitationMetrics:
    """CVR and SR of drones.

    Parameters
    ----------
    game : DroneGame
        With its constraints.
    trajectories : Trajectories
        Each is judged at its steps and between them.

    Returns
    -------
    ImitationMetrics
        Shares of the trajectories.
    """
    return ImitationMetrics(float(game.violates(trajectories).mean()), float(game.succeeds(trajectories).mean()))


def place_visitation(game: DroneGame, trajectories: Trajectories, spacing: float = 0.5) -> Array:
    """Discounted share of its time that each drone spends in each square of the arena.

    Parameters
    ----------
    game : DroneGame
        With the arena.
    trajectories : Trajectories
        Over which the mean is taken.
    spacing : float, optional
        Largest side of a square [m].

    Returns
    -------
    Array
        Shape (N_E, X, Y), of sum 1 for each drone.
    """
    places = game.positions(trajectories.states)
    counts = np.array(game.settings.lattice(spacing)) - 1
    squares = np.minimum((places / game.arena * counts).astype(np.int64), counts - 1)
    numbers = squares[..., 0] * counts[1] + squares[..., 1]
    weights = np.broadcast_to(game.discount ** np.arange(places.shape[1]), places.shape[:2]) / len(places)
    by_drone = [weighted_counts(numbers[..., i], weights, int(counts.prod())) for i in range(game.n_experts)]
    return np.asarray(np.stack(by_drone).reshape(-1, *counts) / weights.sum())


def visitation_distance(visitations: Sequence[Array]) -> float:
    """Largest total variation distance of two policies' place visitations, mean over the drones, in [0, 1]."""
    return max(
        (float(np.abs(a - b).sum() / 2 / len(a)) for i, a in enumerate(visitations) for b in visitations[:i]),
        default=0.0,
    )
