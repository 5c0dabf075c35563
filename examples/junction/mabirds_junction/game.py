"""Vehicles on lanes that cross in one place: each goes or waits, and no two may be in the junction at once."""

from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Indices, Mask, Vector, weighted_counts
from mabirds_core.digest import trajectory_digest
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.tabular.decoding import whole_numbers
from mabirds_core.games.tabular.game import EnumerableGame
from mabirds_junction.features import JunctionCostFeatures, JunctionRewardFeatures
from mabirds_junction.lanes import Lanes
from mabirds_junction.settings import JunctionSettings


class JunctionGame(EnumerableGame):
    """``EnumerableGame`` brings rewards, expectations, experts, the judge and a picture; the rest is here."""

    def __init__(self, settings: JunctionSettings) -> None:
        self.settings = settings
        self.lanes = lanes = Lanes(settings.lengths, settings.crossings)
        self.n_experts, self.n_states, self.n_actions = lanes.n_vehicles, lanes.n_states, lanes.n_actions
        self.horizon = self.deadline = settings.horizon
        self.discount = settings.discount
        self.cost_features = JunctionCostFeatures(lanes)
        self.reward_features = JunctionRewardFeatures(lanes)

    @cached_property
    def digest(self) -> str:
        """Of the lanes and the horizon."""
        return trajectory_digest("junction", self.settings.lengths, self.horizon)

    @cached_property
    def successor(self) -> Indices:
        """successor[s, a], shape (S, A)."""
        cells = self.lanes.cells(np.arange(self.n_states))[:, :, None]
        goes = self.lanes.moves(np.arange(self.n_actions))[:, None, :]
        last = np.array(self.settings.lengths)[:, None, None] - 1
        return self.lanes.joint_state(np.minimum(cells + goes, last))

    @cached_property
    def initial_distribution(self) -> Vector:
        """P_0: each of the starts equally likely, shape (S,)."""
        states = self.lanes.joint_state(np.array(self.settings.starts).T)
        return weighted_counts(states, np.full(len(states), 1 / len(states)), self.n_states)

    @cached_property
    def goal(self) -> Mask:
        """goal[s]: has every vehicle left? Shape (S,)."""
        return np.asarray(self._left.all(axis=0))

    @cached_property
    def _left(self) -> Mask:
        last = np.array(self.settings.lengths)[:, None] - 1
        return np.asarray(self.lanes.cells(np.arange(self.n_states)) == last)

    @cached_property
    def violation(self) -> Mask:
        """violation[s, a]: two vehicles in the junction, shape (S, A)."""
        return np.repeat(self.lanes.meeting[:, None] > 0, self.n_actions, axis=1)

    @cached_property
    def task_reward(self) -> Array:
        """-step_cost per step for each vehicle under way, shape (S, A)."""
        under_way = (~self._left).sum(axis=0)
        return np.repeat(-self.settings.step_cost * under_way[:, None], self.n_actions, axis=1)

    @cached_property
    def true_constraints(self) -> Mask:
        """Meeting in the junction alone, shape (K,)."""
        return np.array([False] * sum(self.settings.lengths) + [self.n_experts > 1])

    def encode(self, trajectory: Trajectories) -> tuple[Array, Array]:
        """The vehicles' cells (T + 1, N_E), and 1 where they go, 0 where they wait (T + 1, N_E)."""
        cells, goes = self.lanes.cells(trajectory.states[0]), self.lanes.moves(trajectory.actions[0])
        return cells.T.astype(np.float64), goes.T.astype(np.float64)

    def decode(self, states: Array, actions: Array) -> Trajectories:
        """Inverse of ``encode``, checked step by step."""
        shape = (self.horizon + 1, self.n_experts)
        cells = whole_numbers("states", states, shape, list(self.settings.lengths))
        goes = whole_numbers("actions", actions, shape, [2] * self.n_experts)
        joint, chosen = self.lanes.joint_state(cells.T), self.lanes.joint_action(goes.T)
        wrong = np.flatnonzero(joint[1:] != self.successor[joint[:-1], chosen[:-1]])
        if len(wrong):
            step = int(wrong[0])
            raise ImpossibleTrajectoryError(
                f"step {step}: vehicles at {cells[step].tolist()} with moves {goes[step].tolist()} are then at"
                f" {cells[step + 1].tolist()}, which no lane allows"
            )
        return Trajectories(joint[None], chosen[None])
