"""The actor of a game whose values are known: pi_t(a|s) ~ mu(a) exp Q_t(s, a), over cells of the discs of actions.

    Q_t(s, a) = r(s, a) + gamma ( sum_i V^i_{t+1}(s'_i) + sum_{i<j} C^ij_{t+1}(s'_i, s'_j) )

with V and C of the ``guide``. It is the improvement that the actor of a soft actor-critic follows by gradients, made at
once: a cell of each drone's disc is drawn by mu times exp Q at its point, of all drones together (``joint_cells``);
then a part of each cell, by exp Q of the drone alone; and an action in it, uniformly. Its density is known, and so is
its gap. A drone in its goal region, where no action moves it, does nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.drones.disc_cells import DiscCells
from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.guide import Guidance, Guide
from mabirds_core.games.drones.joint_cells import drawn_cells, drawn_columns, exponentials
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.planner_checks import GUIDE, spacing_of
from mabirds_core.games.drones.rewards import DroneRewardModel
from mabirds_core.games.interface import Trajectories
from mabirds_core.planners.interface import Policy

CELLS = DiscCells()

BLOCK = 256
"""Joint states of which cells are drawn at once: tables of all cells of a pair are megabytes each."""


@dataclass(frozen=True)
class GuidedPolicy:
    """The policy, by the values of its guide."""

    guide: Guide

    @property
    def game(self) -> DroneGame:
        """Of single integrators."""
        return self.guide.game

    def act(self, step: int, states: Array, rng: np.random.Generator) -> Array:
        """An action for each of M joint states (M, N_E D), shape (M, 2 N_E)."""
        return self.drawn(step, states, rng)[0]

    def drawn(self, step: int, states: Array, rng: np.random.Generator) -> tuple[Array, Vector]:
        """Draw an action for each joint state.

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
        actions : Array
            Shape (M, 2 N_E).
        log_pi : Vector
            Relative to mu, shape (M,).
        """
        places, most = self.game.positions(states), self.game.dynamics.max_action
        cells, log_pi = self._cells(step, places, rng)
        actions = list[Array]()
        for i, of in enumerate(cells):
            parts, log_ratio = self._parts(i, step, places[:, i], of, rng)
            away = ~self.guide.fields[i].grid.arrived(places[:, i])
            actions.append(away[:, None] * most * CELLS.places(of, parts, rng))
            log_pi += log_ratio
        return np.concatenate(actions, axis=1), log_pi

    def _cells(self, step: int, places: Array, rng: np.random.Generator) -> tuple[list[Indices], Vector]:
        """Cells of each drone, drawn for places (M, N_E, 2), and log pi / mu of them."""
        uniform = [rng.random((len(places), 1)) for _ in range(max(2, self.game.n_experts))]
        blocks = [slice(start, start + BLOCK) for start in range(0, len(places), BLOCK)]
        found = [self._cells_of(step, places[rows], [u[rows] for u in uniform]) for rows in blocks]
        cells, log_pi = zip(*found, strict=True)
        return [np.concatenate(of) for of in zip(*cells, strict=True)], np.concatenate(log_pi)

    def _cells_of(self, step: int, places: Array, uniform: list[Array]) -> tuple[list[Indices], Vector]:
        """The same by random numbers for ``drawn_cells``."""
        game, guide = self.game, self.guide
        moves, log_shares = game.dynamics.max_action * CELLS.points, np.log(CELLS.shares)
        alone, after = zip(*(guide.worth(i, step, places[:, i], moves) for i in range(game.n_experts)), strict=True)
        scores = [(worth + log_shares).astype(np.float32) for worth in alone]
        couplings = {}
        if step < game.horizon:
            for (i, j), coupling in zip(game.pairs, guide.couplings, strict=True):
                couplings[i, j] = np.float32(game.discount) * coupling.values(step + 1, after[i], after[j])
        cells, log_pi = drawn_cells(scores, couplings, uniform)
        return cells, log_pi - sum(log_shares[of] for of in cells)

    def _parts(
        self, drone: int, step: int, places: Array, cells: Indices, rng: np.random.Generator
    ) -> tuple[Indices, Vector]:
        """A part of each cell (M,), and log of how much likelier it is than by its share."""
        moves = self.game.dynamics.max_action * CELLS.middles[cells]
        worth, _ = self.guide.worth(drone, step, places, moves)
        chances, totals = exponentials(worth)
        parts = drawn_columns(chances, rng.random((len(worth), 1)))
        return parts, worth[np.arange(len(parts)), parts] - totals + np.log(worth.shape[1])

    def gap(self, seed: int, flights: int = 64) -> float:
        """By how much the soft return of its flights from P_0 lies below V_0, on average.

        Of three drones or more V_0 is an estimate, and so is what lies below it; it may be less than 0.

        Parameters
        ----------
        seed : int
            Of the flights.
        flights : int, optional
            How many.

        Returns
        -------
        float
            In nats.
        """
        rng = np.random.default_rng([seed, flights])
        starts = self.game.starts(flights, rng)
        return float((self.guide.start_values(starts) - self.soft_returns(starts, rng)).mean())

    def soft_returns(self, states: Array, rng: np.random.Generator) -> Vector:
        """sum_t gamma^t ( r_t / tau - log pi_t ) of one flight from each joint state.

        Parameters
        ----------
        states : Array
            Shape (M, N_E D).
        rng : np.random.Generator
            Of the flights.

        Returns
        -------
        Vector
            In nats, shape (M,).
        """
        game, guide, result = self.game, self.guide, np.zeros(len(states))
        for step in range(game.horizon + 1):
            actions, log_pi = self.drawn(step, states, rng)
            earned = sum(total_reward(game.space, of, weights, states, actions) for of, weights in guide.rewards)
            result += game.discount**step * (earned / guide.temperature - log_pi)
            states = game.step(states, actions)
        return result


@dataclass(frozen=True)
class GuidedPlanner:
    """Values from exact planners, and the actor that they mean."""

    guidance: Guidance

    @classmethod
    def of(
        cls, game: DroneGame, reward: DroneRewardModel, temperature: float, *, draws: bool = True
    ) -> "GuidedPlanner":
        """By lattices of the default spacing.

        Parameters
        ----------
        game : DroneGame
            Of single integrators.
        reward : DroneRewardModel
            r_theta.
        temperature : float
            tau.
        draws : bool, optional
            Does it draw a lattice for every plan, as learners do?

        Returns
        -------
        GuidedPlanner
            For any theta and omega.
        """
        spacing = spacing_of(GUIDE, game)
        return cls(Guidance(LatticePlanner(game, reward, spacing, temperature, draws=draws)))

    def plan(
        self,
        theta: Vector,
        omega: Vector,
        previous: Policy | None = None,
        rng: np.random.Generator | None = None,
        observed: Trajectories | None = None,  # noqa: ARG002 - nothing is learned from examples
    ) -> GuidedPolicy:
        """pi(omega, theta); a ``previous`` policy is used up: its memory is taken over."""
        before = previous.guide if isinstance(previous, GuidedPolicy) else None
        return GuidedPolicy(self.guidance.guide(theta, omega, before, rng))

    def state_dict(self, policy: Policy) -> dict[str, Array]:  # noqa: ARG002 - nothing is searched
        """No arrays: values are found anew."""
        return {}

    def load_state_dict(self, memory: Mapping[str, Array]) -> None:
        """Nothing to remember."""
