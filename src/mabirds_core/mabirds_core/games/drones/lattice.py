"""The constrained soft Bellman policy of one or two drones by soft value iteration on a lattice of places.

At temperature tau, with the base measure mu of actions uniform in the disc of radius max_speed,

    Q_t(s, a) = r_theta(s, a) + omega^T phi(s, a) + gamma V_{t+1}(s')
    V_t(s)    = tau log E_{a ~ mu} exp(Q_t(s, a) / tau),     V_{T+1} = 0,     pi_t(a|s) ~ mu(a) exp(Q_t(s, a) / tau)

which is the soft Bellman policy of the reward divided by tau. Rewards are sums of terms of one drone and of a pair
(``features``), and drones move independently of one another. Hence the backup factorises. With Y = exp(gamma
V_{t+1} / tau) on the lattice nodes of both drones and exp(gamma V / tau) interpolated between them, it is

    exp(V_t / tau) = exp(r_12 / tau) * ( K_1 Y K_2^T ),     K_i[s, s'] = sum_a mu(a) exp(r_i(s, a) / tau) B_i[s, a, s']

where B_i[s, a, .] are the bilinear weights of the place that action a leads to: two sparse products per step instead
of a sum over all joint actions. mu is taken at 25 actions per drone. In the game itself, the policy chooses among the
same actions, by V_{t+1} interpolated between the nodes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from mabirds_core.arrays import Array, Indices, Mask, Vector
from mabirds_core.games.drones.features import DroneReward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.rewards import DroneRewardModel
from mabirds_core.games.drones.stencils import Lattice, action_rewards
from mabirds_core.games.interface import Trajectories
from mabirds_core.planners.interface import Policy

UNDERFLOW = 1e-250
"""Below this, beside the best that two drones could do without each other, sums of exp have lost their precision."""

CHUNK = 5_000_000
"""Terms that are summed up in logs at once."""


@dataclass(frozen=True)
class LatticePolicy:
    """The policy, kept as V_t / tau on the nodes of both drones."""

    lattice: Lattice
    rewards: tuple[tuple[DroneReward, Vector], ...]
    """What r is the sum of, each with its parameters."""
    temperature: float
    values: Array
    """Shape (T + 2, S, S), or (T + 2, S, 1) for a single drone."""

    def act(self, step: int, states: Array, rng: np.random.Generator) -> Array:
        """An action of each drone for M joint states (M, N_E D), shape (M, 2 N_E)."""
        velocities, _ = self.lattice.action_set
        scores = self.log_weights(step, states).reshape(len(states), -1)
        cumulative = np.exp(scores - scores.max(axis=1, keepdims=True)).cumsum(axis=1)
        drawn = (cumulative <= rng.random((len(states), 1)) * cumulative[:, -1:]).sum(axis=1)
        n = self.lattice.game.n_experts
        chosen = np.stack(np.unravel_index(drawn, (len(velocities),) * n), axis=1)
        return np.asarray(velocities[chosen].reshape(len(states), -1))

    def log_weights(self, step: int, states: Array) -> Array:
        """log mu(a) + Q_t(s, a) / tau up to terms that depend on s alone.

        Parameters
        ----------
        step : int
            t.
        states : Array
            Joint states, shape (M, N_E D).

        Returns
        -------
        Array
            Shape (M, A, A), or (M, A, 1) for a single drone.
        """
        game, ahead = self.lattice.game, self.values[step + 1]
        stencils, drones = self.lattice.stencils(game.positions(states)), game.drones(states)
        unary = [
            action_rewards(self.lattice, self.rewards, i, drones[:, i], self.temperature) for i in range(game.n_experts)
        ]
        first = stencils.nodes[:, 0]
        if game.n_experts == 1:
            return np.asarray(unary[0][:, :, None] + game.discount * (stencils.weights[:, 0] @ ahead[first]))
        around = ahead[first[:, :, None], stencils.nodes[:, 1][:, None, :]]
        backup = stencils.weights[:, 0] @ around @ stencils.weights[:, 1].swapaxes(1, 2)
        return np.asarray(unary[0][:, :, None] + unary[1][:, None, :] + game.discount * backup)


@dataclass(frozen=True)
class LatticePlanner:
    """Near-exact: the error is that of the lattice alone. For one or two single integrators."""

    game: DroneGame
    reward_model: DroneRewardModel
    spacing: float
    """Largest distance of two neighbouring nodes [m]."""
    temperature: float

    @cached_property
    def lattice(self) -> Lattice:
        """The nodes, and where actions lead from them."""
        return Lattice(self.game, self.spacing)

    def plan(
        self,
        theta: Vector,
        omega: Vector,
        previous: Policy | None = None,  # noqa: ARG002 - nothing is searched
        rng: np.random.Generator | None = None,  # noqa: ARG002 - nothing is drawn
        observed: Trajectories | None = None,  # noqa: ARG002 - nothing is learned from examples
    ) -> LatticePolicy:
        """pi(omega, theta)."""
        rewards = ((self.reward_model, theta), (self.game.cost_features, omega))
        kernels = [TransitionKernel.of(self.lattice, rewards, i, self.temperature) for i in range(self.game.n_experts)]
        if len(kernels) == 1:
            kernels.append(TransitionKernel.trivial())
            pairwise_terms = np.zeros((1, 1))
        else:
            distances = self.lattice.pair_distances
            pairwise_terms = sum((reward.pairwise(w, 0, distances) for reward, w in rewards), np.zeros_like(distances))
        values = np.zeros((self.game.horizon + 2, kernels[0].size, kernels[1].size))
        for step in range(self.game.horizon, -1, -1):
            values[step] = backup(kernels[0], kernels[1], self.game.discount * values[step + 1])
            values[step] += pairwise_terms / self.temperature
        return LatticePolicy(self.lattice, rewards, self.temperature, values)

    def state_dict(self, policy: Policy) -> dict[str, Array]:  # noqa: ARG002 - nothing is searched
        """No arrays: the planner is exact from any start."""
        return {}

    def load_state_dict(self, memory: Mapping[str, Array]) -> None:
        """No policy: the planner needs none to start from."""


@dataclass(frozen=True)
class TransitionKernel:
    """log K_i of one drone: from each of S nodes to the W nodes around it."""

    nodes: Indices
    """Shape (S, W)."""
    logs: Array
    """Shape (S, W); -inf where no action leads."""

    @classmethod
    def of(
        cls, lattice: Lattice, rewards: tuple[tuple[DroneReward, Vector], ...], drone: int, temperature: float
    ) -> "TransitionKernel":
        """log K_i from every node of the lattice.

        Parameters
        ----------
        lattice : Lattice
            With S nodes.
        rewards : tuple[tuple[DroneReward, Vector], ...]
            What r is the sum of, each with its parameters.
        drone : int
            Index i.
        temperature : float
            tau.

        Returns
        -------
        TransitionKernel
            Of this drone.
        """
        scores = action_rewards(lattice, rewards, drone, lattice.nodes, temperature)
        with np.errstate(divide="ignore"):
            weights = np.log(lattice.everywhere.weights[:, drone])
        logs = np.logaddexp.reduce(scores[:, :, None] + weights, axis=1)
        return cls(lattice.everywhere.nodes[:, drone], logs)

    @classmethod
    def trivial(cls) -> "TransitionKernel":
        """The kernel of a drone that has nowhere to go, for games of one."""
        return cls(np.zeros((1, 1), dtype=np.int64), np.zeros((1, 1)))

    @property
    def size(self) -> int:
        """S, how many nodes there are."""
        return len(self.nodes)

    @cached_property
    def reached(self) -> Mask:
        """Where actions lead, shape (S, W)."""
        return np.isfinite(self.logs)

    @cached_property
    def row_ends(self) -> Indices:
        """Row pointers of the sparse matrix, shape (S + 1,)."""
        return np.concatenate([[0], self.reached.sum(axis=1).cumsum()])

    def scaled(self, potential: Vector) -> tuple[csr_array, Vector]:
        """K diag(exp(potential)) with every row divided by exp of the second result, shape (S,)."""
        terms = self.logs + potential[self.nodes]
        largest = terms.max(axis=1)
        entries = np.exp(terms - largest[:, None])[self.reached]
        columns = self.nodes[self.reached]
        return csr_array((entries, columns, self.row_ends), shape=(self.size, self.size)), largest


def backup(first: TransitionKernel, second: TransitionKernel, ahead: Array) -> Array:
    """log ( K_1 exp(ahead) K_2^T ).

    Values range over thousands of nats, exp over 700. What one drone's place is worth at best is taken out of
    ``ahead`` first and goes into that drone's kernel, where it is scaled row by row; what is left is what the drones
    cost each other. Where even that is too much, every pair of nodes around the drones is summed up in logs.

    Parameters
    ----------
    first : TransitionKernel
        K_1.
    second : TransitionKernel
        K_2.
    ahead : Array
        gamma V_{t+1} / tau, shape (S, S).

    Returns
    -------
    Array
        Shape (S, S).
    """
    best = ahead.max(axis=1)
    rest = ahead - best[:, None]
    other = rest.max(axis=0)
    (k1, shift1), (k2, shift2) = first.scaled(best), second.scaled(other)
    half = np.ascontiguousarray((k1 @ np.exp(rest - other)).T)
    total = (k2 @ half).T
    values = np.asarray(np.log(np.maximum(total, UNDERFLOW)) + shift1[:, None] + shift2)
    if total.min() < UNDERFLOW:
        hard = np.argwhere(total < UNDERFLOW)
        terms = len(hard) * first.nodes.shape[1] * second.nodes.shape[1]
        for some in np.array_split(hard, 1 + terms // CHUNK):
            values[tuple(some.T)] = pair_by_pair(first, second, ahead, some)
    return values


def pair_by_pair(first: TransitionKernel, second: TransitionKernel, ahead: Array, states: Indices) -> Vector:
    """Some entries of ``backup`` without exp of anything but differences to the largest term.

    Parameters
    ----------
    first : TransitionKernel
        K_1.
    second : TransitionKernel
        K_2.
    ahead : Array
        gamma V_{t+1} / tau, shape (S, S).
    states : Indices
        Which entries, shape (H, 2).

    Returns
    -------
    Vector
        Shape (H,).
    """
    here, there = states.T
    terms = ahead[first.nodes[here][:, :, None], second.nodes[there][:, None, :]]
    terms = terms + first.logs[here][:, :, None] + second.logs[there][:, None, :]
    most = terms.max(axis=(1, 2))
    return np.asarray(most + np.log(np.exp(terms - most[:, None, None]).sum(axis=(1, 2))))
