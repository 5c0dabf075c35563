"""A step as a game of its own, T = 0: policies are exact, and Algorithm 1 climbs the likelihood of what was chosen.

    pi(a|s)  proportional to  mu(a) exp( theta^T f(s, a) + omega^T phi(s, a) )

States are the numbers of decisions in a table, actions those of moves.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from mabirds_bringup.bench.pedestrians.features import Tables, WalkFeatures
from mabirds_bringup.bench.pedestrians.situations import Situations
from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.digest import trajectory_digest
from mabirds_core.games.interface import Steps, Trajectories, Visitation
from mabirds_core.rewards.models import LinearModel


@dataclass(frozen=True)
class Table:
    """f or phi of all decisions and moves."""

    names: tuple[str, ...]
    values: csr_array
    n_moves: int
    nonnegative: bool = True

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] f(states[k], actions[k]), shape (K,)."""
        rows = visitation.states * self.n_moves + visitation.actions
        weights = np.bincount(rows, visitation.weights, minlength=self.values.shape[0])
        return np.asarray(self.values.T @ weights)


@dataclass(frozen=True)
class StepGame:
    """Decisions as ``games.interface.ConstrainedMarkovGame``."""

    features: WalkFeatures
    situations: Situations
    horizon: int = 0
    discount: float = 1.0
    n_experts: int = 1
    true_constraints: None = None

    @cached_property
    def digest(self) -> str:
        """Of the situations."""
        return trajectory_digest("steps", *(of.tolist() for of in self.situations))

    @cached_property
    def tables(self) -> Tables:
        """Of all decisions."""
        return self.features.tables(self.situations)

    @property
    def n_moves(self) -> int:
        """A."""
        return self.features.moves.count

    @cached_property
    def cost_features(self) -> Table:
        """phi."""
        return Table(self.features.cost_names, self.tables.cost, self.n_moves)

    @cached_property
    def reward_features(self) -> Table:
        """f."""
        return Table(self.features.reward_names, self.tables.reward, self.n_moves)

    def encode(self, trajectory: Trajectories) -> tuple[Array, Array]:
        """The numbers of a decision and of its move, shape (1, 1) each."""
        states, actions = (np.asarray(values, np.float64).reshape(-1, 1) for values in trajectory)
        return states, actions

    def decode(self, states: Array, actions: Array) -> Trajectories:
        """Inverse of ``encode``."""
        return Trajectories(*(values.astype(np.int64).reshape(1, -1) for values in (states, actions)))


@dataclass(frozen=True)
class StepReward(LinearModel):
    """r_theta = theta^T f."""

    game: StepGame

    @property
    def features(self) -> Table:
        """f of the game."""
        return self.game.reward_features


class StepPolicy(NamedTuple):
    """The policy of theta and omega, in any situation."""

    features: WalkFeatures
    theta: Vector
    omega: Vector

    def log_chances(self, situations: Situations) -> Array:
        """log pi(a|s), shape (M, A)."""
        return self.of_tables(self.features.tables(situations))

    def of_tables(self, tables: Tables) -> Array:
        """The same where the features are known."""
        scores = (tables.reward @ self.theta + tables.cost @ self.omega).reshape(-1, self.features.moves.count)
        return normalised(scores + self.features.moves.log_shares)


def normalised(scores: Array) -> Array:
    """Logarithms of chances that are proportional to exp(scores), by row."""
    scores = scores - scores.max(axis=1, keepdims=True)
    return np.asarray(scores - np.log(np.exp(scores).sum(axis=1, keepdims=True)))


@dataclass(frozen=True)
class StepPlanner:
    """Exact: there is nothing to plan beyond what the features look ahead."""

    game: StepGame

    def plan(
        self,
        theta: Vector,
        omega: Vector,
        previous: Any = None,  # noqa: ARG002 - no search that could start from it
        rng: np.random.Generator | None = None,  # noqa: ARG002 - nothing is drawn
        observed: Trajectories | None = None,  # noqa: ARG002 - nothing is learned from examples
    ) -> StepPolicy:
        """The policy of these parameters."""
        return StepPolicy(self.game.features, theta, omega)

    def state_dict(self, policy: Any) -> dict[str, Array]:  # noqa: ARG002 - nothing is searched
        """No arrays."""
        return {}

    def load_state_dict(self, memory: Mapping[str, Array]) -> None:
        """No policy."""


@dataclass(frozen=True)
class StepExpectation:
    """The moves of a policy in the situations in which demonstrations began."""

    game: StepGame

    def __call__(
        self,
        policy: StepPolicy,
        rng: np.random.Generator,  # noqa: ARG002 - nothing is drawn
        starts: Steps | None = None,
    ) -> Visitation:
        """Every move with its chance."""
        every = np.arange(self.game.situations.size) if starts is None else np.asarray(starts)
        states, counts = np.unique(every, return_counts=True)
        rows = (states[:, None] * self.game.n_moves + np.arange(self.game.n_moves)).ravel()
        tables = Tables(*(of[rows] for of in self.game.tables))
        chances = np.exp(policy.of_tables(tables)) * (counts / len(every))[:, None]
        moves: Indices = np.tile(np.arange(self.game.n_moves), len(states))
        return Visitation(np.repeat(states, self.game.n_moves), moves, chances.ravel())
