"""Where vehicles are, as numbers: the value object that game and features share."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mabirds_core.arrays import Indices


@dataclass(frozen=True)
class Lanes:
    """Lanes of so many cells, of which one each is the junction. Joint states and actions are mixed-radix numbers."""

    lengths: tuple[int, ...]
    crossings: tuple[int, ...]

    @property
    def n_vehicles(self) -> int:
        """N_E."""
        return len(self.lengths)

    @property
    def n_states(self) -> int:
        """S."""
        return int(np.prod(self.lengths))

    @property
    def n_actions(self) -> int:
        """A: each vehicle waits (0) or goes (1)."""
        return int(2**self.n_vehicles)

    def cells(self, states: NDArray[np.integer]) -> Indices:
        """The vehicles' cells in joint ``states`` of any shape: (N_E, *states.shape)."""
        return np.array(np.unravel_index(states, self.lengths))

    def moves(self, actions: NDArray[np.integer]) -> Indices:
        """1 where a vehicle goes and 0 where it waits: (N_E, *actions.shape)."""
        return np.array(np.unravel_index(actions, (2,) * self.n_vehicles))

    def joint_state(self, cells: NDArray[np.integer]) -> Indices:
        """Inverse of ``cells``."""
        return np.asarray(np.ravel_multi_index(tuple(cells), self.lengths))

    def joint_action(self, moves: NDArray[np.integer]) -> Indices:
        """Inverse of ``moves``."""
        return np.asarray(np.ravel_multi_index(tuple(moves), (2,) * self.n_vehicles))

    @cached_property
    def meeting(self) -> Indices:
        """meeting[s]: pairs of vehicles in the junction at once, shape (S,)."""
        inside = (self.cells(np.arange(self.n_states)) == np.array(self.crossings)[:, None]).sum(axis=0)
        return np.asarray(inside * (inside - 1) // 2)
