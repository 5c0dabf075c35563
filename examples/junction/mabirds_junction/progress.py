"""A reward model of its own: what each vehicle gains per step by how far it has come."""

from dataclasses import dataclass

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.interface import Visitation
from mabirds_junction.lanes import Lanes


@dataclass(frozen=True)
class ProgressReward:
    """r_theta(s, a) = sum_i theta_i x_i, x_i in [0, 1]: how far vehicle i is along its lane. theta(1) = 0."""

    lanes: Lanes

    @property
    def size(self) -> int:
        """One number per vehicle."""
        return self.lanes.n_vehicles

    def initial(self, rng: np.random.Generator) -> Vector:  # noqa: ARG002 - other models draw from it
        """theta(1): zeros."""
        return np.zeros(self.size)

    def _progress(self, states: Array) -> Array:
        """x_i, shape (N_E, M)."""
        last = np.array(self.lanes.lengths)[:, None] - 1
        return np.asarray(self.lanes.cells(states) / np.maximum(1, last))

    def table(self, theta: Vector) -> Array:
        """r_theta(s, a), shape (S, A)."""
        of_state = theta @ self._progress(np.arange(self.lanes.n_states))
        return np.repeat(of_state[:, None], self.lanes.n_actions, axis=1)

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:  # noqa: ARG002 - linear in theta
        """sum_k weights[k] x(states[k]), shape (N_E,)."""
        return np.asarray(self._progress(visitation.states) @ visitation.weights)
