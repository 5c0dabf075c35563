"""Patrols judged by patrols that nobody learned from, where no truth is known.

What is told is where experts go: the chance of the joint state after, over all joint moves that lead there. So who has
left, and moves against the edge of the map, change nothing. Beside the learned policies, moves of each expert alone,

    pi(a|s)  proportional to  exp( -|c' - c*|^2 / 2 sigma^2 )

with c' the cell after, sigma that makes the training likeliest, and c* one cell straight to the goal, or
2 c_t - c_{t-1} (constant velocity, which is told the first step); and counting: how often the training made a move in a
cell.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from mabirds_core.arithmetic import log
from mabirds_core.arrays import Array, Indices, Mask, Vector
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.recordings import Forecast
from mabirds_core.metrics.displacement import displacements
from mabirds_core.planners.soft_bellman import log_sum_exp, soft_bellman_policy

if TYPE_CHECKING:
    from mabirds_core.games.patrol.game import PatrolGame

STEP_COSTS = np.geomspace(0.25, 16.0, 7)
"""That are tried for experts who know their goals and nothing else [nats a step]."""

NOISES = np.geomspace(0.1, 10.0, 40)
"""sigma that are tried [cells]."""

UNSEEN = 0.5
"""Counts of a move before anything is counted."""


class Chooser(Protocol):
    """Who says how likely joint moves are."""

    def log_probabilities(self, step: int, states: Indices, before: Indices | None) -> Array:
        """log pi of all joint moves.

        Parameters
        ----------
        step : int
            t.
        states : Indices
            Joint states, shape (M,).
        before : Indices or None
            Those of the step before; None at the first step.

        Returns
        -------
        Array
            Shape (M, A).
        """
        ...


@dataclass(frozen=True)
class OfPolicy:
    """A policy, which needs no step before."""

    policy: Any

    def log_probabilities(self, step: int, states: Indices, before: Indices | None) -> Array:  # noqa: ARG002
        """log pi of all joint moves, shape (M, A)."""
        return np.asarray(self.policy.log_probabilities(step, states))


Scores = Callable[[int, Indices, Indices | None], Array]
"""log pi but for a constant of one expert's moves, from its index, its cells (M,) and those before; (M, moves)."""


@dataclass(frozen=True)
class ByExpert:
    """Experts each for itself."""

    game: "PatrolGame"
    scores: Scores

    def log_probabilities(self, step: int, states: Indices, before: Indices | None) -> Array:  # noqa: ARG002
        """log pi of all joint moves, shape (M, A)."""
        game, joint = self.game, np.zeros((len(states), 1))
        cells = game.cells(states)
        earlier = [None] * game.n_experts if before is None else [*game.cells(before)]
        for expert, (own, own_before) in enumerate(zip(cells, earlier, strict=True)):
            scores = self.scores(expert, own, own_before)
            logs = scores - log_sum_exp(scores)[:, None]
            joint = (joint[:, :, None] + logs[:, None, :]).reshape(len(states), -1)
        return joint


@dataclass(frozen=True)
class PatrolForecast:
    """A chooser as a forecast."""

    game: "PatrolGame"
    chooser: Chooser
    told: bool = False
    """Is it told the first step?"""

    def log_ratios(self, demonstrations: Trajectories) -> Vector:
        """Nats by which demonstrations are likelier than under the uniform policy, shape (m,)."""
        game, (states, actions) = self.game, demonstrations
        total = np.zeros(len(states))
        for step in range(game.horizon + 1):
            here, before = states[:, step], states[:, step - 1] if step else None
            leads = game.successor[here]
            there = leads == np.take_along_axis(leads, actions[:, step, None], axis=1)
            logs = np.where(there, self.chooser.log_probabilities(step, here, before), -np.inf)
            ratios = log_sum_exp(logs) - log(there.mean(axis=1))
            total += np.where(game.goal[here], 0.0, ratios)
        return total

    def rollouts(self, demonstrations: Trajectories, count: int, rng: np.random.Generator) -> Trajectories:
        """``count`` patrols from each demonstration's start."""
        game, before = self.game, None
        first, here = (np.repeat(values[:, 0], count) for values in (demonstrations.actions, demonstrations.states))
        states, actions = list[Indices](), list[Indices]()
        for step in range(game.horizon + 1):
            scores = self.chooser.log_probabilities(step, here, before)
            drawn = (scores + rng.gumbel(size=scores.shape)).argmax(axis=1)
            states.append(here)
            actions.append(first if self.told and step == 0 else drawn)
            before, here = here, game.transitions.draw(here, actions[-1], rng)
        return Trajectories(np.stack(states, axis=1), np.stack(actions, axis=1))


@dataclass(frozen=True)
class HeldOutPatrols:
    """How patrols are compared with patrols that were held out."""

    game: "PatrolGame"

    def of_policy(self, policy: Any) -> Forecast:
        """A learned policy as a forecast."""
        return PatrolForecast(self.game, OfPolicy(policy))

    def baselines(self, policy: Any, planner: Any, training: Trajectories) -> Mapping[str, Forecast]:  # noqa: ARG002
        """What is to be beaten, by name; numbers are those that make the training likeliest."""
        game, moving = self.game, Ways(self.game)
        nothing = ByExpert(game, lambda _, cells, __: np.zeros((len(cells), game.n_moves)))
        goals = [OfPolicy(soft_bellman_policy(game, cost * self.under_way)) for cost in -STEP_COSTS]
        straight = [ByExpert(game, moving.straight(noise)) for noise in NOISES]
        same = [ByExpert(game, moving.same(noise)) for noise in NOISES]
        return {
            "uniform": PatrolForecast(game, nothing),
            "maximum entropy, goals told": self._likeliest(goals, training),
            "counting": PatrolForecast(game, ByExpert(game, counted(game, training))),
            "constant velocity": self._likeliest(same, training, told=True),
            "straight to the goal": self._likeliest(straight, training),
        }

    def _likeliest(self, choosers: list[Any], training: Trajectories, *, told: bool = False) -> PatrolForecast:
        forecasts = [PatrolForecast(self.game, chooser, told) for chooser in choosers]
        return max(forecasts, key=lambda of: float(of.log_ratios(training).mean()))

    @cached_property
    def under_way(self) -> Array:
        """How many experts have not arrived, shape (S, A)."""
        game = self.game
        cells = game.cells(np.arange(game.n_states))
        count = sum(~of[own] for of, own in zip(game.grid.is_goal, cells, strict=True)) * np.ones(game.n_states)
        return np.repeat(count[:, None], game.n_actions, axis=1)

    def steps(self, demonstrations: Trajectories) -> Vector:
        """Steps until all experts have arrived, of each demonstration, shape (m,)."""
        return np.asarray((~self.game.goal[demonstrations.states]).sum(axis=1), dtype=np.float64)

    def displacements(self, demonstrations: Trajectories, flown: Trajectories, count: int) -> tuple[Array, Array]:
        """Distances of patrols to what was shown [m], or in cells where those have no metres.

        Parameters
        ----------
        demonstrations : Trajectories
            m of them.
        flown : Trajectories
            ``count`` from each start, those of the first start first.
        count : int
            k.

        Returns
        -------
        tuple[Array, Array]
            Mean over experts and steps until the expert shown has arrived, and mean over experts at that step or the
            last one; shape (m, k) each.
        """
        shown, walked = self._middles(demonstrations), self._middles(flown)
        return displacements(shown, walked, self._under_way(demonstrations), count)

    def _middles(self, trajectories: Trajectories) -> Array:
        """Of the experts' cells, shape (m, T + 1, N_E, 2) [m]."""
        rows, columns = np.divmod(self.game.cells(trajectories.states), self.game.width)
        return np.moveaxis(np.stack([columns, -rows], axis=-1), 0, -2) * (self.game.settings.cell or 1.0)

    def _under_way(self, demonstrations: Trajectories) -> Mask:
        """Which experts have not arrived, shape (m, T + 1, N_E)."""
        cells = self.game.cells(demonstrations.states)
        return np.stack([~of[own] for of, own in zip(self.game.grid.is_goal, cells, strict=True)], axis=-1)

    def conflicts(self, trajectories: Trajectories) -> Mapping[str, float]:
        """Shares of trajectories in which experts share cells, and in which they swap them."""
        sharing = self.game.sharing[trajectories.states] > 0
        swapping = self.game.grid.swapping_in(*trajectories) > 0
        return {"sharing": float(sharing.any(axis=1).mean()), "swapping": float(swapping.any(axis=1).mean())}


@dataclass(frozen=True)
class Ways:
    """Where experts are expected next."""

    game: "PatrolGame"

    @cached_property
    def places(self) -> Array:
        """Row and column of each cell, shape (n, 2)."""
        return np.stack(np.divmod(np.arange(self.game.n_cells), self.game.width), axis=-1).astype(np.float64)

    @cached_property
    def to_goal(self) -> Array:
        """One cell at most straight to the nearest goal, of each expert from each cell, shape (N_E, n, 2)."""
        found = list[Array]()
        for goal in self.game.grid.is_goal:
            ways = self.places[goal] - self.places[:, None]
            nearest = ways[np.arange(len(ways)), (ways**2).sum(axis=-1).argmin(axis=1)]
            found.append(nearest / np.maximum(1.0, np.sqrt((nearest**2).sum(axis=-1, keepdims=True))))
        return np.stack(found)

    def straight(self, noise: float) -> Scores:
        """To the goal."""
        return lambda expert, cells, _: self._near(expert, cells, self.to_goal[expert, cells], noise)

    def same(self, noise: float) -> Scores:
        """As in the step before; to the goal where there was none."""

        def scores(expert: int, cells: Indices, before: Indices | None) -> Array:
            known = before is not None
            ways = self.places[cells] - self.places[before] if known else self.to_goal[expert, cells]
            return self._near(expert, cells, ways, noise)

        return scores

    def _near(self, expert: int, cells: Indices, ways: Array, noise: float) -> Array:
        after = self.places[self.game.expert_successor[expert, cells]]
        away = ((after - (self.places[cells] + ways)[:, None]) ** 2).sum(axis=-1)
        return np.asarray(-away / (2 * noise**2))


def counted(game: "PatrolGame", training: Trajectories) -> Scores:
    """How often moves were made in cells.

    Parameters
    ----------
    game : PatrolGame
        Of the training.
    training : Trajectories
        m of them.

    Returns
    -------
    Scores
        Logarithms of counts, UNSEEN at least.
    """
    counts = np.full((game.n_experts, game.n_cells, game.n_moves), UNSEEN)
    for expert, (cells, moves) in enumerate(
        zip(game.cells(training.states), game.moves(training.actions), strict=True)
    ):
        np.add.at(counts[expert], (cells.ravel(), moves.ravel()), 1.0)
    return lambda expert, cells, _: np.asarray(log(counts[expert, cells]))
