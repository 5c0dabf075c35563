"""From the learners' parameters to numbers: what each policy would do, and what it took for a constraint."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mabirds_core.arrays import Array, weighted_counts
from mabirds_core.assembly import build_game, policy_of
from mabirds_core.experiment import Experiment
from mabirds_core.games.patrol import PatrolGame
from mabirds_core.metrics import (
    consensus_distance,
    constraint_errors,
    exact_imitation,
    learned_constraints,
    policy_distance,
)
from mabirds_core.parameters import Parameters
from mabirds_core.policies.interface import Policy
from mabirds_core.policies.occupancy import occupancy_measure
from mabirds_core.simulate import History


@dataclass(frozen=True)
class Row:
    """One learner at one iteration; rates in [0, 1]."""

    learner: str
    iteration: int
    violation_rate: float
    success_rate: float
    false_positive_rate: float
    false_negative_rate: float


@dataclass(frozen=True)
class Evaluation:
    """Rows by learner and iteration, and the consensus distances by iteration."""

    rows: list[Row]
    consensus_theta: list[float]
    consensus_omega: list[float]
    consensus_policy: float
    learned: dict[str, list[str]]

    def final(self, learner: str) -> Row:
        """The newest row of a learner."""
        return [row for row in self.rows if row.learner == learner][-1]

    def of(self, learner: str) -> list[Row]:
        """A learner's rows in order."""
        return [row for row in self.rows if row.learner == learner]


def evaluate(experiment: Experiment, history: History, on_row: Callable[[], None] = lambda: None) -> Evaluation:
    """Evaluate theta(n), omega(n) of all learners and iterations, exactly; ``on_row`` is called after each."""
    game = build_game(experiment)
    rows = []
    for name, parameters in history.items():
        policy = policy_of(experiment, name, game)
        for iteration, one in enumerate(parameters, start=1):
            imitation = exact_imitation(game, policy(one))
            errors = constraint_errors(one.omega, game.true_constraints, experiment.constraint_threshold)
            rows.append(Row(name, iteration, *imitation, *errors))
            on_row()
    together = list(zip(*history.values(), strict=False))
    final = {name: parameters[-1] for name, parameters in history.items()}
    return Evaluation(
        rows,
        [consensus_distance([one.theta for one in ones]) for ones in together],
        [consensus_distance([one.omega for one in ones]) for ones in together],
        policy_distance(game, [policy_of(experiment, name, game)(one) for name, one in final.items()]),
        {name: _learned_names(experiment, game.cost_features.names, one) for name, one in final.items()},
    )


def _learned_names(experiment: Experiment, names: tuple[str, ...], parameters: Parameters) -> list[str]:
    learned = learned_constraints(parameters.omega, experiment.constraint_threshold)
    return [names[k] for k in np.flatnonzero(learned)]


def summary(experiment: Experiment, evaluation: Evaluation, seconds: float) -> dict[str, Any]:
    """What summary.json holds. ``seconds``: wall time of the run."""
    learners = {}
    for name in evaluation.learned:
        final = asdict(evaluation.final(name))
        learners[name] = {
            "iterations": min(final.pop("iteration") - 1, experiment.iterations),
            **{key: value for key, value in final.items() if key != "learner"},
            "learned_constraints": evaluation.learned[name],
        }
    return {
        "experiment": experiment.name,
        "constraint_threshold": experiment.constraint_threshold,
        "rates": "exact: by following the policy's probability mass, not by sampling",
        "learners": learners,
        "consensus_distance": {
            "theta": evaluation.consensus_theta[-1],
            "omega": evaluation.consensus_omega[-1],
            "policy": evaluation.consensus_policy,
        },
        "wall_seconds": seconds,
    }


def visits(game: PatrolGame, policy: Policy) -> Array:
    """Discounted visitation of each expert's cells, shape (N_E, n), each row of sum 1."""
    of_state = occupancy_measure(game, policy).sum(axis=1)
    cells = game.cells(np.arange(game.n_states))
    return np.stack([weighted_counts(own, of_state, game.n_cells) for own in cells])
