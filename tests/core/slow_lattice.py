"""The recursion of the lattice planner once more, slowly and in the open: all joint moves of all joint nodes."""

from itertools import product
from typing import NamedTuple

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.nodes import NodeLattice
from mabirds_core.games.drones.rewards import LinearDroneReward, NeuralDroneReward, TrueDroneReward
from mabirds_core.games.interface import Visitation

Model = LinearDroneReward | NeuralDroneReward | TrueDroneReward


def log_sum_exp(terms: Array) -> Vector:
    """Along the last axis."""
    most = terms.max(axis=-1, keepdims=True)
    return np.asarray(most[..., 0] + np.log(np.exp(terms - most).sum(axis=-1)))


class Ahead(NamedTuple):
    """Joint moves from one joint state: the joint nodes where they lead, log mu, and log mu + r / tau."""

    nodes: list[tuple[int, ...]]
    log_shares: Vector
    scores: Vector


class SlowLattice:
    """Values of all joint nodes; a drone's nodes are numbered as the lattice's are."""

    def __init__(self, model: Model, at: Parameters, lattice: NodeLattice, temperature: float = 1.0) -> None:
        self.model, self.game, self.at, self.temperature = model, model.game, at, temperature
        self.lattice, self.size = lattice, len(lattice.places)
        self.states = list(product(range(self.size), repeat=self.game.n_experts))
        self.moves = [self.ahead(np.concatenate([lattice.places[node] for node in state])) for state in self.states]
        self.values = np.zeros((self.game.horizon + 2, *self.game.n_experts * [self.size]))
        for step in range(self.game.horizon, -1, -1):
            for state, ahead in zip(self.states, self.moves, strict=True):
                self.values[(step, *state)] = log_sum_exp(self.q(step, ahead))

    def ahead(self, state: Vector) -> Ahead:
        """What can be done in a joint state."""
        own = [self.own_moves(drone, place) for drone, place in enumerate(state.reshape(-1, 2))]
        joint = list(product(*own))
        actions = np.array([np.concatenate([velocity for _, _, velocity in moves]) for moves in joint])
        here = np.repeat(state[None], len(actions), axis=0)
        reward = total_reward(self.game.space, self.model, self.at.theta, here, actions)
        cost = total_reward(self.game.space, self.game.cost_features, self.at.omega, here, actions)
        log_shares = np.array([sum(np.log(share) for _, share, _ in moves) for moves in joint])
        nodes = [tuple(node for node, _, _ in moves) for moves in joint]
        return Ahead(nodes, log_shares, log_shares + (reward + cost) / self.temperature)

    def own_moves(self, drone: int, place: Vector) -> list[tuple[int, float, Vector]]:
        """Node, share and velocity of each move of one drone."""
        goal, step = self.game.settings.drones[drone].goal_region, self.game.settings.time_step
        away = np.hypot(*(self.lattice.places - place).T)
        if np.hypot(*(place - goal.centre)) <= goal.radius:
            return [(int(away.argmin()), 1.0, np.zeros(2))]
        (nodes,), (shares,) = self.lattice.moves_from(place[None])
        near = np.flatnonzero(away <= step * self.game.settings.max_speed * (1 + 1e-9))
        assert sorted(nodes[nodes >= 0]) == near.tolist()
        return [(int(n), float(shares[nodes == n][0]), (self.lattice.places[n] - place) / step) for n in near]

    def q(self, step: int, ahead: Ahead) -> Vector:
        """log mu + Q_t / tau of joint moves."""
        later = np.array([self.values[(step + 1, *nodes)] for nodes in ahead.nodes])
        return np.asarray(ahead.scores + self.game.discount * later)

    def log_ratios(self, step: int, state: Vector) -> dict[tuple[int, ...], float]:
        """log pi_t/mu by the joint nodes where moves lead."""
        ahead = self.ahead(state)
        q = self.q(step, ahead)
        return dict(zip(ahead.nodes, (q - log_sum_exp(q) - ahead.log_shares).tolist(), strict=True))

    def totals(self, starts: Array) -> Vector:
        """E sum_t gamma^t phi from equally likely joint starts: the analytic occupancy, joint move by joint move."""
        features, total = self.game.cost_features, 0.0
        occupied = {tuple(start): 1 / len(starts) for start in starts.tolist()}
        for step in range(self.game.horizon + 1):
            after = dict[tuple[float, ...], float]()
            for state, chance in occupied.items():
                ahead = self.ahead(np.array(state))
                q = self.q(step, ahead)
                chances = chance * np.exp(q - log_sum_exp(q))
                total = total + self.game.discount**step * self.counted(np.array(state), ahead, chances)
                for nodes, one in zip(ahead.nodes, chances.tolist(), strict=True):
                    there = tuple(self.game.step(np.array(state), self.velocities(np.array(state), nodes)).tolist())
                    after[there] = after.get(there, 0.0) + one
            occupied = after
        assert len(total) == len(features.names)
        return np.asarray(total)

    def counted(self, state: Vector, ahead: Ahead, chances: Vector) -> Vector:
        """Cost features of a joint state's moves, weighed by chances."""
        actions = np.array([self.velocities(state, nodes) for nodes in ahead.nodes])
        return self.game.cost_features.total(Visitation(np.repeat(state[None], len(actions), axis=0), actions, chances))

    def velocities(self, state: Vector, nodes: tuple[int, ...]) -> Vector:
        """Which lead from a joint state to joint nodes."""
        ways = np.concatenate([self.lattice.places[node] for node in nodes]) - state
        arrived = np.repeat(self.game.arrived(state[None])[0], 2)
        return np.where(arrived, 0.0, ways / self.game.settings.time_step)
