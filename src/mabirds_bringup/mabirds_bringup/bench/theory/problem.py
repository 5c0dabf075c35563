"""The game and the experts: two of them swap the corners of a 3x3 map round a wall.

Soft constraints (b > 0): the experts' policy is the soft Bellman policy of a finite reward and finite costs, so that
some theta and omega reproduce it exactly. Hard constraints (b = 0): it is the maximum-entropy policy among the ways
that break none; no finite omega reproduces it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mabirds_bringup.bench.theory.cases import LEARNERS, TheoryCase
from mabirds_core.arrays import Array, Vector
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Streams
from mabirds_core.games.interface import Trajectories
from mabirds_core.planners.interface import TabularPolicy
from mabirds_core.planners.occupancy import discounted_steps, occupancy_measure, pairs_of, rollouts
from mabirds_core.planners.soft_bellman import maximum_entropy_policy, soft_bellman_policy

GAME = {
    "map": "...\n.#.\n...",
    "starts": [[[0, 0], [2, 2]]],
    "goals": [[2, 2], [0, 0]],
    "horizon": 6,
    "discount": 0.95,
}
COST = 2.0
"""Of each true constraint, where constraints are soft."""


@dataclass(frozen=True)
class Problem:
    """A case's game, experts and network."""

    case: TheoryCase
    iterations: int
    seed: int

    @cached_property
    def experiment(self) -> Experiment:
        """As a file would have it."""
        reward = {"kind": "linear", "lateness": False}
        algorithm: dict[str, Any] = {"expectation": "exact", "reward": reward, "share_shown": False}
        if self.case.etas is not None:
            steps = {"kind": "paper", "alpha": self.case.step, "beta": self.case.step, **self.case.etas._asdict()}
            algorithm |= {"steps": steps, "window": self.case.window, "rollout_start": "initial"}
        content = {
            "name": "theory",
            "game": GAME,
            "learners": LEARNERS,
            "schedule": dict(self.case.schedule),
            "iterations": self.iterations,
            "demonstrations": {"bag": "none", "per_learner": self.iterations},
            "algorithm": algorithm,
            "seed": self.seed,
        }
        return Experiment.model_validate(content)

    @cached_property
    def game(self) -> Any:
        """Two experts on nine cells: 81 joint states."""
        return build_game(self.experiment)

    @cached_property
    def experts(self) -> TabularPolicy:
        """Who demonstrates."""
        if self.case.hard:
            return maximum_entropy_policy(self.game, self.game.violation)
        costs = np.where(self.game.true_constraints, -COST, 0.0)
        return soft_bellman_policy(self.game, self.game.task_reward + self.game.cost_features.table(costs))

    def streams(self) -> Streams:
        """Each learner's demonstrations, drawn from the seed."""
        rng = np.random.default_rng(self.seed)
        drawn = {name: rollouts(self.game, self.experts, self.iterations, rng) for name in LEARNERS}
        return {name: [_row(of, k) for k in range(self.iterations)] for name, of in drawn.items()}

    @cached_property
    def expert_occupancy(self) -> Array:
        """Expected discounted visits of the experts, shape (S, A)."""
        return discounted_steps(self.game) * occupancy_measure(self.game, self.experts)

    @cached_property
    def budget(self) -> Vector:
        """b: expected mu of the experts, shape (K_omega,)."""
        return self.game.cost_features.total(pairs_of(self.expert_occupancy))

    @cached_property
    def expert_features(self) -> Vector:
        """Expected grad J of the experts, shape (K_theta,)."""
        return self.game.reward_features.total(pairs_of(self.expert_occupancy))

    @cached_property
    def true_theta(self) -> Vector:
        """The experts' own reward as weights of the reward features, by least squares."""
        features = self.game.reward_features
        columns = [features.table(unit).ravel() for unit in np.eye(len(features.names))]
        return np.asarray(np.linalg.lstsq(np.array(columns).T, self.game.task_reward.ravel())[0])


def _row(trajectories: Trajectories, k: int) -> Trajectories:
    return Trajectories(trajectories.states[k : k + 1], trajectories.actions[k : k + 1])
