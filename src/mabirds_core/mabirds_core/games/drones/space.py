"""The space that drones share: the arena, and joint states and actions by drone. Metres throughout."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mabirds_core.arrays import Array


@dataclass(frozen=True)
class DroneSpace:
    """An arena in which N_E drones of D numbers each fly: joint states (..., N_E D), joint actions (..., 2 N_E)."""

    sides: tuple[float, float]
    """Width and depth [m]."""
    n_experts: int
    drone_size: int
    """D: 2 for places, 4 with velocities."""

    @property
    def state_size(self) -> int:
        """N_E D."""
        return self.n_experts * self.drone_size

    @property
    def action_size(self) -> int:
        """2 N_E."""
        return 2 * self.n_experts

    @property
    def arena(self) -> Array:
        """Width and depth, shape (2,) [m]."""
        return np.array(self.sides)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Indices of every two drones."""
        return list(combinations(range(self.n_experts), 2))

    def grid(self, spacing: float) -> tuple[int, int]:
        """Points of a lattice over the arena that is no coarser than ``spacing``, by axis."""
        width, depth = (int(np.ceil(side / spacing * (1 - 1e-9))) + 1 for side in self.sides)
        return width, depth

    def drones(self, states: Array) -> Array:
        """Joint states (..., N_E D) by drone: (..., N_E, D)."""
        return states.reshape(*states.shape[:-1], self.n_experts, self.drone_size)

    def positions(self, states: Array) -> Array:
        """Where the drones of joint states (..., N_E D) are: (..., N_E, 2)."""
        return self.drones(states)[..., :2]

    def controls(self, actions: Array) -> Array:
        """Joint actions (..., 2 N_E) by drone: (..., N_E, 2)."""
        return actions.reshape(*actions.shape[:-1], self.n_experts, 2)
