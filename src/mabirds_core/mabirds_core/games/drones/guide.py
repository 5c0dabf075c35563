"""What exact planners know of games of single integrators at any place: V_t, for continuous actions.

    V_t(s) = sum_i V^i_t(s_i) + sum_{i<j} C^ij_t(s_i, s_j)

with V^i of each drone alone, by quadrature over its disc of actions (``lone_fields``), and with C^ij, what two drones
cost each other, from the planner on a lattice (``pair_coupling``), of the game of these two alone. All are in units of
tau. Of one or two drones what is missed, the sum of gamma^t ( V_t - log int mu exp Q_t ) along flights, is some tenths
of a nat. Of three or more V is an estimate: it misses what a third drone changes in how two avoid each other.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.drone_nodes import Rewards
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.lone_fields import FieldGrid, LoneField
from mabirds_core.games.drones.pair_coupling import PairCoupling
from mabirds_core.games.drones.pair_games import pair_game, rewards_of_pair


@dataclass(frozen=True)
class Guide:
    """The values for one theta and omega.

    Attributes
    ----------
    game : DroneGame
        Whose values these are.
    rewards : Rewards
        What r is the sum of.
    temperature : float
        tau.
    fields : list[LoneField]
        V^i of every drone.
    couplings : list[PairCoupling]
        C^ij of every two drones, in the order of the game's pairs.
    """

    game: DroneGame
    rewards: Rewards
    temperature: float
    fields: list[LoneField]
    couplings: list[PairCoupling]

    def start_values(self, states: Array) -> Vector:
        """V_0 of joint states (M, N_E D) with C_0 by first moves to nodes, in nats, shape (M,)."""
        places, result = self.game.positions(states), np.zeros(len(states))
        for i, field in enumerate(self.fields):
            result += field.at(0, places[:, i])
        for pair, coupling in zip(self.game.pairs, self.couplings, strict=True):
            result += coupling.at_start(places[:, pair].reshape(len(states), -1))
        return result

    def values(self, step: int, states: Array) -> Vector:
        """V_t of joint states.

        Parameters
        ----------
        step : int
            t, from 1 on.
        states : Array
            Shape (M, N_E D).

        Returns
        -------
        Vector
            In nats, shape (M,); 0 past the horizon.
        """
        result = np.zeros(len(states))
        if step > self.game.horizon:
            return result
        places = self.game.positions(states)
        for i, field in enumerate(self.fields):
            result += field.at(step, places[:, i])
        for (i, j), coupling in zip(self.game.pairs, self.couplings, strict=True):
            result += coupling.values(step, places[:, i, None], places[:, j, None])[:, 0, 0]
        return result

    def worth(self, drone: int, step: int, places: Array, actions: Array) -> tuple[Array, Array]:
        """What actions are worth to a drone without the other one, less r(s, 0): e(s, a) + gamma V^i_{t+1}(s').

        Parameters
        ----------
        drone : int
            Index i.
        step : int
            t.
        places : Array
            Of the drone, shape (M, 2) [m].
        actions : Array
            Shape (M, K, 2) or (K, 2) [m/s].

        Returns
        -------
        worth : Array
            In nats, shape (M, K).
        successors : Array
            Where they lead, shape (M, K, 2).
        """
        field, dynamics = self.fields[drone], self.game.dynamics.of_drone(drone)
        shape = (len(places), *actions.shape[-2:])
        here, controls = np.broadcast_to(places[:, None], shape), np.broadcast_to(actions, shape)
        after = np.asarray(dynamics.step(here[..., None, :], controls[..., None, :]))[..., 0, :]
        away = ~field.grid.arrived(places)[:, None]
        earned = field.effort * (controls**2).sum(axis=-1) + field.arriving * field.grid.arrived(after)
        return away * earned + self.game.discount * field.at(step + 1, after), after


@dataclass(frozen=True)
class Guidance:
    """Makes guides for any theta and omega.

    Attributes
    ----------
    planner : LatticePlanner
        Of the game; those of its pairs are like it.
    """

    planner: LatticePlanner

    @cached_property
    def grids(self) -> list[FieldGrid]:
        """Of every drone."""
        return [FieldGrid(self.planner.game, i) for i in range(self.planner.game.n_experts)]

    @cached_property
    def pairs(self) -> list[LatticePlanner]:
        """Of every two drones alone."""
        game = self.planner.game
        return [replace(self.planner, game=pair_game(game, pair)) for pair in range(len(game.pairs))]

    def guide(self, theta: Vector, omega: Vector, previous: Guide | None, rng: np.random.Generator | None) -> Guide:
        """Solve.

        Parameters
        ----------
        theta : Vector
            Of the reward.
        omega : Vector
            Weights of the cost features.
        previous : Guide or None
            It is used up: its memory is taken over, pair by pair.
        rng : np.random.Generator or None
            Of the lattice.

        Returns
        -------
        Guide
            Of all pairs on the same one of the planner's lattices.
        """
        game, temperature = self.planner.game, self.planner.temperature
        rewards = ((self.planner.reward_model, theta), (game.cost_features, omega))
        number = self.planner.number(rng)
        used = [None] * len(self.pairs) if previous is None else [of.lattice for of in previous.couplings]
        couplings = [
            PairCoupling(planner.plan_on(number, rewards_of_pair(game, pair, rewards), used[pair]))
            for pair, planner in enumerate(self.pairs)
        ]
        fields = [LoneField.of(grid, rewards, temperature) for grid in self.grids]
        return Guide(game, rewards, temperature, fields, couplings)
