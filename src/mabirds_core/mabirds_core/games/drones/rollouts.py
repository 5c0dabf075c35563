"""Following a policy of the drone game."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.interface import Trajectories, Visitation, discounted_visitation


class DronePolicy(Protocol):
    """A time-dependent stochastic policy pi_t(a | s) that can be drawn from."""

    def act(self, step: int, states: Array, rng: np.random.Generator) -> Array:
        """Draw an action for each of M joint states.

        Parameters
        ----------
        step : int
            t.
        states : Array
            Shape (M, N_E D).
        rng : np.random.Generator
            Of the draw.

        Returns
        -------
        Array
            Shape (M, 2 N_E).
        """
        ...


def drone_rollouts(
    game: DroneGame, policy: DronePolicy, count: int, rng: np.random.Generator, starts: Array | None = None
) -> Trajectories:
    """Follow a policy.

    Parameters
    ----------
    game : DroneGame
        Whose dynamics lead on.
    policy : DronePolicy
        pi_t(a | s).
    count : int
        m: how many trajectories.
    rng : np.random.Generator
        Of starts and actions.
    starts : Array, optional
        Joint states, shape (k, N_E D), each equally likely; default: P_0.

    Returns
    -------
    Trajectories
        m of them.
    """
    current = game.starts(count, rng) if starts is None else starts[rng.integers(len(starts), size=count)]
    states = np.empty((count, game.horizon + 1, game.state_size))
    actions = np.empty((count, game.horizon + 1, game.action_size))
    for step in range(game.horizon + 1):
        states[:, step] = current
        actions[:, step] = policy.act(step, current, rng)
        current = game.step(current, actions[:, step])
    return Trajectories(states, actions)


@dataclass(frozen=True)
class SampledDroneOccupancy:
    """Means over ``count`` rollouts: the paper's m trajectories zeta^j."""

    game: DroneGame
    count: int

    def __call__(self, policy: DronePolicy, rng: np.random.Generator, starts: Array | None = None) -> Visitation:
        """The rollouts' visitation."""
        return discounted_visitation(drone_rollouts(self.game, policy, self.count, rng, starts), self.game.discount)
