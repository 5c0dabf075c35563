"""The constrained soft Bellman policy of one or two drones that fly from node to node of a lattice.

At temperature tau, with the base measure mu of the moves to the nodes within reach (``nodes``),

    Q_t(s, a) = r_theta(s, a) + omega^T phi(s, a) + gamma V_{t+1}(s')
    V_t(s)    = tau log sum_a mu(a) exp(Q_t(s, a) / tau),     V_{T+1} = 0,     pi_t(a|s) = mu(a) exp((Q_t - V_t) / tau)

which is the soft Bellman policy of the reward divided by tau. Flights from node to node are flights of the drone game,
so this game is solved exactly: along every flight, however likely,

    V_0(s_0) = sum_t gamma^t ( r_t - log pi_t/mu )

(``LatticePolicy.residuals`` is by how much it is missed). Rewards are sums of terms of one drone and of a pair, and
drones move independently of one another; hence they are solved for one by one, and ``coupling`` has what is left.

A lattice has corners that no other has, and what is learned on one grid alone belongs to it. So every plan takes one of
several lattices, which are rotated and shifted against each other.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.drones.coupling import PairProblem, Table, couple, strip_indices
from mabirds_core.games.drones.drone_nodes import DroneNodes, Rewards, pair_rewards
from mabirds_core.games.drones.features import pair_distances, total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lone_drone import LoneDrone, log_sum_exp
from mabirds_core.games.drones.nodes import NodeLattice, Shape
from mabirds_core.games.drones.rewards import DroneRewardModel
from mabirds_core.games.drones.table_memory import Codes, table_memory
from mabirds_core.games.interface import Trajectories
from mabirds_core.planners.interface import Policy

NO_MEMORY: Codes = np.empty(0, np.uint16)


class Choices(NamedTuple):
    """What can be done in M joint states.

    Attributes
    ----------
    nodes : list[Indices]
        Where the moves of each drone lead, shape (M, A_i); -1 where there is no such move.
    log_shares : Array
        log mu of joint moves, shape (M, A_1, A_2), or (M, A_1, 1) for a single drone; -inf where there is none.
    scores : Array
        log mu + Q_t / tau without what the pair earns in s, of the same shape.
    """

    nodes: list[Indices]
    log_shares: Array
    scores: Array

    @property
    def totals(self) -> Vector:
        """log of the sum of exp of the scores, shape (M,)."""
        return log_sum_exp(self.scores.reshape(len(self.scores), -1))

    def drawn(self, rng: np.random.Generator) -> list[Indices]:
        """Where each drone goes, drawn with the policy's probabilities, shape (M,) each."""
        rows, scores = np.arange(len(self.scores)), self.scores.reshape(len(self.scores), -1)
        cumulative = np.exp(scores - scores.max(axis=1, keepdims=True)).cumsum(axis=1)
        drawn = (cumulative <= rng.random((len(rows), 1)) * cumulative[:, -1:]).sum(axis=1)
        chosen = np.unravel_index(drawn, self.scores.shape[1:])
        return [moves[rows, chosen[i]] for i, moves in enumerate(self.nodes)]

    def log_ratios(self, nodes: list[Indices]) -> Vector:
        """log pi_t/mu of joint moves.

        Parameters
        ----------
        nodes : list[Indices]
            Where each drone goes, shape (M,) each.

        Returns
        -------
        Vector
            In nats, shape (M,).

        Raises
        ------
        ValueError
            Some of them are no moves from there.
        """
        found = [of == node[:, None] for of, node in zip(self.nodes, nodes, strict=True)]
        if not all(one.any(axis=1).all() for one in found):
            raise ValueError("expected moves to nodes within reach; these flights are of another lattice")
        columns = [*(one.argmax(axis=1) for one in found), np.zeros(len(self.scores), np.int64)][:2]
        at = (np.arange(len(self.scores)), *columns)
        return np.asarray(self.scores[at] - self.log_shares[at] - self.totals)


@dataclass(frozen=True)
class LatticePolicy:
    """The policy, kept as what each drone is worth alone and what they cost each other."""

    game: DroneGame
    rewards: Rewards
    temperature: float
    drones: list[LoneDrone]
    tables: list[Table]
    """C_t for t = 1 .. T; none for a single drone, and none any more of a policy that was used up."""
    memory: Codes
    """Where they are kept."""

    def release(self) -> Codes:
        """Its memory, if it still has some, for another policy: this one cannot be followed any more."""
        memory = self.memory if self.tables else NO_MEMORY
        self.tables.clear()
        return memory

    def act(self, step: int, states: Array, rng: np.random.Generator) -> Array:
        """An action of each drone for M joint states (M, N_E D), shape (M, 2 N_E): they lead to nodes exactly."""
        return self._velocities(states, self.choices(step, states).drawn(rng))

    def choices(self, step: int, states: Array) -> Choices:
        """Moves of M joint states.

        Parameters
        ----------
        step : int
            t.
        states : Array
            Shape (M, N_E D).

        Returns
        -------
        Choices
            And what they are worth.

        Raises
        ------
        ValueError
            A state cannot be reached by then from the squares of P_0, so that nothing was planned for it.
        """
        places = self.game.positions(states)
        moves = [drone.moves(step, places[:, i]) for i, drone in enumerate(self.drones)]
        nodes, shares, scores = zip(*moves, strict=True)
        if len(moves) == 1:
            return Choices([*nodes], shares[0][:, :, None], scores[0][:, :, None])
        joint = scores[0][:, :, None] + scores[1][:, None, :]
        if step < self.game.horizon:
            joint += self.game.discount * self._coupling(step + 1, places, [*nodes])
        return Choices([*nodes], shares[0][:, :, None] + shares[1][:, None, :], joint)

    def values(self, step: int, states: Array) -> Vector:
        """V_t / tau of joint states.

        Parameters
        ----------
        step : int
            t.
        states : Array
            Shape (M, N_E D).

        Returns
        -------
        Vector
            Shape (M,).
        """
        return self._here(states) + self.choices(step, states).totals

    def lone_values(self, drone: int, places: Array) -> Vector:
        """V^i_0 / tau of a drone without the other one.

        Parameters
        ----------
        drone : int
            Index i.
        places : Array
            Shape (M, 2) [m].

        Returns
        -------
        Vector
            Shape (M,).
        """
        return log_sum_exp(self.drones[drone].moves(0, places).scores)

    def residuals(self, trajectories: Trajectories) -> Vector:
        """The certificate: V_0(s_0) - sum_t gamma^t ( r_t - log pi_t/mu ) along flights from node to node.

        Parameters
        ----------
        trajectories : Trajectories
            Flights of this policy, m of them.

        Returns
        -------
        Vector
            In nats, shape (m,): 0 but for rounding.
        """
        game, states, actions = self.game, *trajectories
        result = self.values(0, states[:, 0])
        for step in range(game.horizon + 1):
            here, action = states[:, step], actions[:, step]
            ratios = self.choices(step, here).log_ratios(self._nodes(game.step(here, action)))
            earned = sum(total_reward(game.space, of, weights, here, action) for of, weights in self.rewards)
            result -= game.discount**step * (earned / self.temperature - ratios)
        return result

    def _nodes(self, states: Array) -> list[Indices]:
        """The nodes where the drones of joint states are; the nearest ones for places between nodes."""
        places = self.game.positions(states)
        return [drone.nodes.nearest(places[:, i]) for i, drone in enumerate(self.drones)]

    def _velocities(self, states: Array, nodes: list[Indices]) -> Array:
        places = self.game.positions(states)
        ways = [drone.nodes.velocities(places[:, i], nodes[i][:, None]) for i, drone in enumerate(self.drones)]
        return np.concatenate([way[:, 0] for way in ways], axis=1)

    def _here(self, states: Array) -> Vector:
        """r_12 / tau in joint states."""
        if self.game.n_experts == 1:
            return np.zeros(len(states))
        (distances,) = pair_distances(self.game.space, states)
        total = sum((of.pairwise(weights, 0, distances) for of, weights in self.rewards), np.zeros(len(states)))
        return np.asarray(total / self.temperature)

    def _coupling(self, step: int, places: Array, nodes: list[Indices]) -> Array:
        """C_t where joint moves lead, shape (M, A_1, A_2)."""
        if not self.tables:
            raise ValueError("this policy was the previous one of another plan, which took its memory; plan anew")
        for i, drone in enumerate(self.drones):
            late = (nodes[i] >= drone.nodes.reached[step - 1]).any(axis=1)
            if late.any():
                where = places[late, i][0].round(3).tolist()
                raise ValueError(
                    f"drone {i + 1} at {where} before step {step}: not planned for, as it cannot get there from its"
                    " square of starts; make start_spread larger"
                )
        return self.tables[step - 1].values(np.maximum(nodes[0], 0)[:, :, None], np.maximum(nodes[1], 0)[:, None, :])


@dataclass(frozen=True)
class LatticePlanner:
    """Exact on lattices, for one or two single integrators."""

    game: DroneGame
    reward_model: DroneRewardModel
    spacing: float
    """Of neighbouring nodes [m], at most the way that a drone flies in a step."""
    temperature: float = 1.0
    shape: Shape = "hexagonal"
    rotations: int = 8
    """How many lattices there are to draw from. One more is for who does not draw: it judges."""
    draws: bool = True
    """Draw a lattice for every plan?"""

    @cached_property
    def lattices(self) -> list[list[DroneNodes]]:
        """By number and drone; they are made when they are first looked into."""
        arena, reach = self.game.settings.arena, self.game.dynamics.reach
        count, drones = self.rotations + 1, range(self.game.n_experts)
        lattices = [NodeLattice.one_of(arena, reach, self.spacing, self.shape, k, count) for k in range(count)]
        return [[DroneNodes(self.game, lattice, i) for i in drones] for lattice in lattices]

    def plan(
        self,
        theta: Vector,
        omega: Vector,
        previous: Policy | None = None,
        rng: np.random.Generator | None = None,
        observed: Trajectories | None = None,  # noqa: ARG002 - nothing is learned from examples
    ) -> LatticePolicy:
        """pi(omega, theta) on the lattice that ``rng`` draws, if it does; else on the one that judges.

        A ``previous`` policy is used up: its memory is taken over.
        """
        rewards = ((self.reward_model, theta), (self.game.cost_features, omega))
        return self.plan_on(self.number(rng), rewards, previous)

    def number(self, rng: np.random.Generator | None) -> int:
        """Of the lattice that ``rng`` draws, if it does; else 0, of the one that judges."""
        return 1 + int(rng.integers(self.rotations)) if self.draws and rng is not None else 0

    def every_plan(self, theta: Vector, omega: Vector) -> Iterator[LatticePolicy]:
        """pi(omega, theta) on each of the lattices that may be drawn.

        Parameters
        ----------
        theta : Vector
            Reward parameters.
        omega : Vector
            Cost weights.

        Yields
        ------
        LatticePolicy
            One at a time: the next one takes over the memory of the one before.
        """
        policy, rewards = None, ((self.reward_model, theta), (self.game.cost_features, omega))
        for number in range(1, self.rotations + 1):
            policy = self.plan_on(number, rewards, policy)
            yield policy

    def plan_on(self, number: int, rewards: Rewards, previous: Policy | None) -> LatticePolicy:
        """The policy on one of the lattices, for any rewards.

        Parameters
        ----------
        number : int
            Of the lattice.
        rewards : Rewards
            What r is the sum of.
        previous : Policy or None
            It is used up.

        Returns
        -------
        LatticePolicy
            Exact there.
        """
        drones = [LoneDrone.of(drone, rewards, self.temperature) for drone in self.lattices[number]]
        memory = previous.release() if isinstance(previous, LatticePolicy) else NO_MEMORY
        if len(drones) == 1:
            return LatticePolicy(self.game, rewards, self.temperature, drones, [], memory)
        problem = self._pair_problem(drones, rewards)
        if len(memory) < problem.codes:
            memory = table_memory(problem.codes)
        return LatticePolicy(self.game, rewards, self.temperature, drones, couple(problem, memory), memory)

    def _pair_problem(self, drones: list[LoneDrone], rewards: Rewards) -> PairProblem:
        """What decides C_t of two drones."""
        first, second = (drone.nodes for drone in drones)
        scaled = tuple((of, weights / self.temperature) for of, weights in rewards)
        return PairProblem(
            lambda i, step: drones[i].kernel(step),
            np.stack([first.reached, second.reached]),
            pair_rewards(first, second, scaled, strip_indices(first.size, second.size)),
            pair_rewards(second, first, scaled, strip_indices(second.size, first.size)),
            self.game.discount,
        )

    def state_dict(self, policy: Policy) -> dict[str, Array]:  # noqa: ARG002 - nothing is searched
        """No arrays: the planner is exact from any start."""
        return {}

    def load_state_dict(self, memory: Mapping[str, Array]) -> None:
        """No policy: the planner needs none to start from."""
