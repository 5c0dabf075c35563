"""Tiny games and slow, obvious re-computations that the tests of mabirds_core compare with."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.interface import TabularGame, Trajectories
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.planners.interface import Policy

Cell = tuple[int, int]
Cells = tuple[Cell, ...]
Moves = tuple[int, ...]

STRAIGHT = [(-1, 0), (0, 1), (1, 0), (0, -1)]
"""North, east, south, west as (rows, columns)."""
DIAGONAL = [(-1, 1), (1, 1), (1, -1), (-1, -1)]
"""Northeast, southeast, southwest, northwest."""


def patrol(
    rows: str,
    starts: Sequence[Cells],
    goals: Sequence[Cell | Cells],
    horizon: int = 2,
    discount: float = 0.9,
    probabilities: Sequence[float] | None = None,
    **options: Any,
) -> PatrolGame:
    """A patrol game in one line."""
    content = {"map": rows, "starts": starts, "goals": goals, "horizon": horizon, "discount": discount}
    return PatrolGame(PatrolSettings.model_validate({**content, "start_probabilities": probabilities, **options}))


def square(discount: float = 0.9, horizon: int = 2) -> PatrolGame:
    """2x2 cells, two experts that swap opposite corners: S = 16, A = 16."""
    return patrol("..\n..", [((0, 0), (1, 1))], ((1, 1), (0, 0)), horizon, discount)


def hallway(discount: float = 0.8, horizon: int = 2) -> PatrolGame:
    """2x3 cells with an obstacle, two experts, two starts of unequal probability: S = 36, A = 16."""
    starts = [((0, 0), (0, 2)), ((1, 0), (0, 1))]
    return patrol("...\n.#.", starts, ((1, 2), (0, 0)), horizon, discount, probabilities=[0.25, 0.75])


def trio() -> PatrolGame:
    """2x2 cells with an obstacle, three experts: S = 64, A = 64."""
    return patrol("..\n.#", [((0, 0), (0, 1), (1, 0))], ((0, 1), (1, 0), (0, 0)), horizon=1)


def alone() -> PatrolGame:
    """3x2 cells, one expert and one obstacle: S = 6, A = 4."""
    return patrol("..\n.#\n..", [((0, 0),), ((2, 1),)], ((2, 0),), horizon=3)


def doors(horizon: int = 2, **options: Any) -> PatrolGame:
    """2x3 cells, two experts who may wait, go diagonally and leave, by two doors each of which they share one."""
    exits: list[Cells] = [((0, 2), (1, 2)), ((0, 0), (0, 2))]
    moves = {"waiting": True, "diagonals": True, "leaving": True}
    return patrol("...\n.#.", [((0, 0), (1, 2)), ((1, 0), (0, 1))], exits, horizon, 0.85, **(moves | options))


def crossing_diagonals() -> PatrolGame:
    """2x2 cells, two experts who may go diagonally but not wait, each to two cells of its own: S = 16, A = 64."""
    goals: list[Cells] = [((0, 1), (1, 1)), ((0, 0), (1, 0))]
    return patrol("..\n..", [((0, 0), (0, 1))], goals, 2, diagonals=True)


def slippery(slip: float = 0.3, horizon: int = 2) -> PatrolGame:
    """2x2 cells with an obstacle, two experts who may wait and whose moves slip: S = 16, A = 25."""
    return patrol("..\n.#", [((0, 0), (1, 0))], [(1, 0), (0, 1)], horizon, 0.8, waiting=True, slip=slip)


@dataclass(frozen=True)
class TablePolicy:
    """A policy given by its probabilities[t, s, a]."""

    probabilities: Array

    def log_probabilities(self, step: int, states: Indices) -> Array:
        """log pi_t(a | s)."""
        with np.errstate(divide="ignore"):
            return np.log(self.probabilities[step][states])


def random_policy(game: TabularGame, rng: np.random.Generator) -> TablePolicy:
    """Probabilities drawn uniformly from the simplex at every step and state."""
    return TablePolicy(rng.dirichlet(np.ones(game.n_actions), size=(game.horizon + 1, game.n_states)))


def trajectories_from(game: TabularGame, start: int) -> Trajectories:
    """Every trajectory from one joint state, A^(T + 1) of them."""
    actions = np.array(list(product(range(game.n_actions), repeat=game.horizon + 1)))
    states = np.full_like(actions, start)
    for step in range(game.horizon):
        states[:, step + 1] = game.successor[states[:, step], actions[:, step]]
    return Trajectories(states, actions)


def all_trajectories(game: TabularGame) -> Trajectories:
    """Every trajectory from every start of positive probability."""
    parts = [trajectories_from(game, int(start)) for start in np.flatnonzero(game.initial_distribution)]
    return Trajectories(
        np.concatenate([part.states for part in parts]), np.concatenate([part.actions for part in parts])
    )


def one(trajectories: Trajectories, number: int) -> Trajectories:
    """Trajectory ``number`` alone."""
    return Trajectories(trajectories.states[[number]], trajectories.actions[[number]])


def log_likelihoods(policy: Policy, trajectories: Trajectories) -> Array:
    """log pi_t(a_t | s_t), shape (m, T + 1)."""
    by_step = zip(trajectories.states.T, trajectories.actions.T, strict=True)
    columns = [
        policy.log_probabilities(step, states)[np.arange(len(states)), actions]
        for step, (states, actions) in enumerate(by_step)
    ]
    return np.stack(columns, axis=1)


def probabilities(game: TabularGame, policy: Policy, trajectories: Trajectories) -> Vector:
    """P_0(s_0) prod_t pi_t(a_t | s_t), shape (m,)."""
    chosen = np.exp(log_likelihoods(policy, trajectories).sum(axis=1))
    return game.initial_distribution[trajectories.states[:, 0]] * chosen


def discounted_sums(game: TabularGame, per_step: Array) -> Vector:
    """sum_t gamma^t per_step[:, t], shape (m,)."""
    terms = (game.discount**step * column for step, column in enumerate(per_step.T))
    return sum(terms, np.zeros(len(per_step)))


def returns(game: TabularGame, reward: Array, trajectories: Trajectories) -> Vector:
    """Discounted return of each trajectory for a reward table, shape (m,)."""
    return discounted_sums(game, reward[trajectories.states, trajectories.actions])


def central_differences(function: Callable[[Vector], float], at: Vector, width: float = 1e-5) -> Vector:
    """The gradient of ``function`` by central finite differences."""
    units = np.eye(len(at)) * width
    return np.array([(function(at + unit) - function(at - unit)) / (2 * width) for unit in units])


class SlowPatrol:
    """The rules of the patrol game once more, with tuples, loops and no arrays."""

    def __init__(self, settings: PatrolSettings) -> None:
        self.rows = settings.map.split()
        self.goals = settings.goal_cells
        self.leaving = settings.leaving
        self.steps = STRAIGHT + [(0, 0)] * settings.waiting + DIAGONAL * settings.diagonals
        self.cells = [(r, c) for r in range(len(self.rows)) for c in range(len(self.rows[0]))]
        self.states: list[Cells] = list(product(self.cells, repeat=settings.n_experts))
        self.actions: list[Moves] = list(product(range(len(self.steps)), repeat=settings.n_experts))

    def after(self, state: Cells, action: Moves) -> Cells:
        """Where the experts are one step later."""
        pairs = enumerate(zip(state, action, strict=True))
        return tuple(self._move(i, cell, move) for i, (cell, move) in pairs)

    def _move(self, expert: int, cell: Cell, move: int) -> Cell:
        rows, columns = self.steps[move]
        there = (cell[0] + rows, cell[1] + columns)
        return cell if cell in self.goals[expert] or there not in self.cells else there

    def gone(self, expert: int, cell: Cell) -> bool:
        """Has the expert left?"""
        return self.leaving and cell in self.goals[expert]

    def sharing(self, state: Cells) -> int:
        """Pairs of experts in one cell, neither of whom has left."""
        here = [cell for expert, cell in enumerate(state) if not self.gone(expert, cell)]
        return sum(first == second for first, second in combinations(here, 2))

    def swapping(self, state: Cells, action: Moves) -> int:
        """Pairs of experts, not in one cell, whose ways to the next cell meet in the middle."""
        both = zip(state, self.after(state, action), strict=True)
        middles = [((a + c) / 2, (b + d) / 2) for (a, b), (c, d) in both]
        pairs = combinations(range(len(state)), 2)
        return sum(middles[i] == middles[j] and state[i] != state[j] for i, j in pairs)

    def violates(self, state: Cells, action: Moves) -> bool:
        """Is an expert on an obstacle, do two share a cell, or do two swap?"""
        on_obstacle = any(self.rows[r][c] == "#" for r, c in state)
        return on_obstacle or self.sharing(state) > 0 or self.swapping(state, action) > 0

    def waiting(self, state: Cells) -> int:
        """Experts that have not arrived."""
        return sum(cell not in goals for cell, goals in zip(state, self.goals, strict=True))

    def cost_features(self, state: Cells, action: Moves) -> list[float]:
        """phi(s, a): expert by expert and cell by cell, then sharing, then swapping."""
        indicators = [
            float(own == cell and not self.gone(expert, own)) for expert, own in enumerate(state) for cell in self.cells
        ]
        return [*indicators, float(self.sharing(state)), float(self.swapping(state, action))]

    def reward_features(self, state: Cells, action: Moves) -> list[float]:
        """f(s, a): expert by expert, cell by cell, move by move."""
        moves = range(len(self.steps))
        return [
            float((cell, move) == (own, made) and not self.gone(expert, own))
            for expert, (own, made) in enumerate(zip(state, action, strict=True))
            for cell in self.cells
            for move in moves
        ]

    def feature_table(self, features: Callable[[Cells, Moves], list[float]]) -> Array:
        """features[s, a, k] of every joint state and action."""
        return np.array([[features(state, action) for action in self.actions] for state in self.states])
