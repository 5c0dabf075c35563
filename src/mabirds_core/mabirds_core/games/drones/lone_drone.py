"""What a drone does without the other one, by soft value iteration on its nodes.

V^i_t(s)   = log sum_a mu(a) exp( r_i(s, a) / tau + gamma V^i_{t+1}(s') ),     V^i_{T+1} = 0
P^i_t(a|s) = mu(a) exp( r_i(s, a) / tau + gamma V^i_{t+1}(s') - V^i_t(s) )
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.drones.coupling import Kernel
from mabirds_core.games.drones.drone_nodes import DroneNodes, Rewards


class LoneMoves(NamedTuple):
    """What a drone can do at M places.

    Attributes
    ----------
    nodes : Indices
        Where its moves lead, shape (M, A); -1 where there is no such move.
    log_shares : Array
        log mu, of the same shape; -inf where there is none.
    scores : Array
        log mu + Q^i_t / tau, of the same shape.
    """

    nodes: Indices
    log_shares: Array
    scores: Array


@dataclass(frozen=True)
class LoneDrone:
    """V^i of a drone without the other one, in units of tau."""

    nodes: DroneNodes
    earned: Array
    """log mu(a) + r_i(s, a) at every node, shape (S, A); -inf where there is no such move."""
    values: Array
    """Shape (T + 2, S)."""
    rewards: Rewards
    """What r is the sum of."""
    temperature: float
    """tau."""

    @classmethod
    def of(cls, nodes: DroneNodes, rewards: Rewards, temperature: float) -> "LoneDrone":
        """Soft value iteration.

        Parameters
        ----------
        nodes : DroneNodes
            Where the drone flies.
        rewards : Rewards
            What r is the sum of.
        temperature : float
            tau.

        Returns
        -------
        LoneDrone
            With its values.
        """
        moves, game = nodes.moves, nodes.game
        earned = log_shares(moves.shares) + nodes.rewards(rewards, nodes.places, moves.nodes) / temperature
        values = np.zeros((game.horizon + 2, nodes.size))
        for step in range(game.horizon, -1, -1):
            values[step] = log_sum_exp(earned + game.discount * values[step + 1][moves.nodes])
        return cls(nodes, earned, values, rewards, temperature)

    def moves(self, step: int, places: Array) -> LoneMoves:
        """What the drone can do without the other one.

        Parameters
        ----------
        step : int
            t.
        places : Array
            Shape (M, 2) [m].

        Returns
        -------
        LoneMoves
            From nodes as they were solved for; from places between nodes, the same sums.
        """
        nodes, discount = self.nodes, self.nodes.game.discount
        here = nodes.numbers_at(places)
        after, shares = nodes.moves_from(places, here)
        known, between = here >= 0, here < 0
        earned = np.full(after.shape, -np.inf)
        earned[known, : self.earned.shape[1]] = self.earned[here[known]]
        if between.any():
            rewards = nodes.rewards(self.rewards, places[between], after[between])
            earned[between] = log_shares(shares[between]) + rewards / self.temperature
        return LoneMoves(after, log_shares(shares), earned + discount * self.values[step + 1][after])

    def kernel(self, step: int) -> Kernel:
        """P^i_t between the nodes that can have been reached."""
        count = self.nodes.reached[step - 1]
        moves = np.maximum(self.nodes.moves.nodes[:count], 0)
        backup = self.nodes.game.discount * self.values[step + 1][moves]
        chances = np.exp(self.earned[:count] + backup - self.values[step][:count, None])
        return Kernel(moves.astype(np.int32), chances.astype(np.float32))


def log_shares(shares: Array) -> Array:
    """log mu, -inf where there is no move; of any shape."""
    with np.errstate(divide="ignore"):
        return np.log(shares)


def log_sum_exp(scores: Array) -> Vector:
    """Over the last axis, of which one entry at least is finite."""
    most = scores.max(axis=-1, keepdims=True)
    return np.asarray(most[..., 0] + np.log(np.exp(scores - most).sum(axis=-1)))
