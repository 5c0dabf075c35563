"""What a soft actor-critic learns from: whole trajectories of the drone game, its own and those of the experts.

Rewards are not kept. Every search labels all transitions anew with its own theta and omega.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from mabirds_core.arrays import Array, Indices
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.interface import Trajectories


@dataclass(frozen=True)
class Replay:
    """What was rolled out and demonstrated, the newest last; the oldest makes room for the new.

    Attributes
    ----------
    rollouts : Trajectories
        Of policies before.
    demonstrations : Trajectories
        Each once.
    """

    rollouts: Trajectories
    demonstrations: Trajectories

    @classmethod
    def empty(cls, game: DroneGame) -> Self:
        """A replay without transitions."""
        steps = game.horizon + 1
        nothing = Trajectories(np.empty((0, steps, game.state_size)), np.empty((0, steps, game.action_size)))
        return cls(nothing, nothing)

    def with_rollouts(self, new: Trajectories, capacity: int) -> "Replay":
        """Add rollouts.

        Parameters
        ----------
        new : Trajectories
            Rollouts.
        capacity : int
            Transitions of rollouts that are kept at most, or one trajectory.

        Returns
        -------
        Replay
            With them.
        """
        return Replay(_newest(joined(self.rollouts, new), capacity), self.demonstrations)

    def with_demonstrations(self, observed: Trajectories | None, capacity: int) -> "Replay":
        """Add demonstrations that the replay lacks: a learner's window shows each of them many times.

        Parameters
        ----------
        observed : Trajectories or None
            Demonstrations; None: there are none.
        capacity : int
            Transitions of demonstrations that are kept at most, or one trajectory.

        Returns
        -------
        Replay
            With them.
        """
        if observed is None:
            return self
        keys, fresh = set(_keys(self.demonstrations)), np.zeros(len(observed.states), dtype=bool)
        for number, key in enumerate(_keys(observed)):
            fresh[number] = key not in keys
            keys.add(key)
        new = Trajectories(observed.states[fresh], observed.actions[fresh])
        return Replay(self.rollouts, _newest(joined(self.demonstrations, new), capacity))

    def draws(self, steps: int, batch: int, share: float, discount: float, rng: np.random.Generator) -> Indices:
        """Draw transitions to learn from, of step t as often as gamma^t says: what is lost there counts as much.

        Parameters
        ----------
        steps : int
            Of gradients.
        batch : int
            Transitions per step.
        share : float
            Of a batch that is demonstrated, in [0, 1].
        discount : float
            gamma.
        rng : np.random.Generator
            Of the draw.

        Returns
        -------
        Indices
            Rows of ``transitions``, shape (steps, batch).
        """
        rolled, shown, length = (
            len(self.rollouts.states),
            len(self.demonstrations.states),
            self.rollouts.states.shape[1],
        )
        of_experts = round(share * batch) if shown else 0
        flights = np.concatenate(
            [
                rng.integers(rolled, size=(steps, batch - of_experts)),
                rng.integers(rolled, rolled + max(shown, 1), size=(steps, of_experts)),
            ],
            axis=1,
        )
        length = self.rollouts.states.shape[1]
        cumulative = (discount ** np.arange(length)).cumsum()
        times = np.searchsorted(cumulative, cumulative[-1] * rng.random(flights.shape), side="right")
        return np.asarray(flights * length + np.minimum(times, length - 1))

    @property
    def transitions(self) -> tuple[Array, Array]:
        """States (M, N_E D) and actions (M, 2 N_E), those of rollouts first; row k is of step k mod T + 1."""
        states, actions = joined(self.rollouts, self.demonstrations)
        return states.reshape(-1, states.shape[-1]), actions.reshape(-1, actions.shape[-1])


def joined(first: Trajectories, second: Trajectories) -> Trajectories:
    """Put trajectories together.

    Parameters
    ----------
    first : Trajectories
        Those that come first.
    second : Trajectories
        Those that follow.

    Returns
    -------
    Trajectories
        All of them.
    """
    states, actions = (np.concatenate(parts) for parts in zip(first, second, strict=True))
    return Trajectories(states, actions)


def _newest(trajectories: Trajectories, capacity: int) -> Trajectories:
    count = max(1, capacity // trajectories.states.shape[1])
    return Trajectories(trajectories.states[-count:], trajectories.actions[-count:])


def _keys(trajectories: Trajectories) -> list[bytes]:
    """Equal for equal trajectories; adding 0 makes -0 and 0 alike."""
    return [(s + 0.0).tobytes() + (a + 0.0).tobytes() for s, a in zip(*trajectories, strict=True)]
