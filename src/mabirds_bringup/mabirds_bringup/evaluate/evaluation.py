"""From the learners' parameters to numbers: what each policy would do, and what it took for a constraint."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, weighted_counts
from mabirds_core.experiment.assembly import Game, build_game, policy_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.rollouts import DronePolicy, drone_rollouts
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.game import PatrolGame, PatrolSettings
from mabirds_core.metrics.metrics import (
    Imitation,
    consensus_distance,
    constraint_errors,
    drone_imitation,
    exact_imitation,
    flight_distance,
    learned_constraints,
    place_visitation,
    policy_distance,
)
from mabirds_core.planners.interface import Policy
from mabirds_core.planners.occupancy import occupancy_measure


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


EXACT = "exact: by following the policy's probability mass, not by sampling"
FLIGHTS = 500
"""Flights that judge a policy of drones."""

MOST_JUDGED = 13
"""Iterations of a learner of drones that are judged; each takes a second."""


def judged(experiment: Experiment, count: int) -> list[int]:
    """Which of ``count`` iterations are judged, from 1 on: all where that is quick, always the first and the last."""
    if isinstance(experiment.game, PatrolSettings):
        return list(range(1, count + 1))
    return sorted({round(n) for n in np.linspace(1, count, min(count, MOST_JUDGED))})


def evaluate(experiment: Experiment, history: History, on_row: Callable[[], None] = lambda: None) -> Evaluation:
    """Judge theta(n), omega(n) of all learners, exactly or by flights; ``on_row`` is called after each."""
    game = build_game(experiment)
    rows = []
    for name, parameters in history.items():
        policy = policy_of(experiment, name, game)
        for iteration in judged(experiment, len(parameters)):
            one = parameters[iteration - 1]
            imitation = imitation_of(experiment, game, policy(one))
            errors = constraint_errors(one.omega, game.true_constraints, experiment.constraint_threshold)
            rows.append(Row(name, iteration, *imitation, *errors))
            on_row()
    together = list(zip(*history.values(), strict=False))
    final = {name: parameters[-1] for name, parameters in history.items()}
    return Evaluation(
        rows,
        [consensus_distance([one.theta for one in ones]) for ones in together],
        [consensus_distance([one.omega for one in ones]) for ones in together],
        _policy_distance(experiment, game, [policy_of(experiment, name, game)(one) for name, one in final.items()]),
        {name: _learned_names(experiment, game.cost_features.names, one) for name, one in final.items()},
    )


def imitation_of(experiment: Experiment, game: Game, policy: Policy) -> Imitation:
    """CVR and SR of a policy."""
    if isinstance(game, DroneGame):
        return drone_imitation(game, flights_of(experiment, game, policy))
    return exact_imitation(game, policy)


def flights_of(experiment: Experiment, game: DroneGame, policy: DronePolicy, count: int = FLIGHTS) -> Trajectories:
    """Flights of a policy, the same for every learner and iteration but for what it decides."""
    return drone_rollouts(game, policy, count, np.random.default_rng([experiment.seed, FLIGHTS]))


def _policy_distance(experiment: Experiment, game: Game, policies: Sequence[Policy]) -> float:
    if isinstance(game, DroneGame):
        return flight_distance([place_visitation(game, flights_of(experiment, game, one)) for one in policies])
    return policy_distance(game, policies)


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
        "rates": _rates_words(experiment),
        "learners": learners,
        "consensus_distance": {
            "theta": evaluation.consensus_theta[-1],
            "omega": evaluation.consensus_omega[-1],
            "policy": evaluation.consensus_policy,
        },
        "wall_seconds": seconds,
    }


def _rates_words(experiment: Experiment) -> str:
    if isinstance(experiment.game, PatrolSettings):
        return EXACT
    return f"shares of {FLIGHTS} flights of the policy that theta and omega mean, found anew"


def visits(game: PatrolGame, policy: Policy) -> Array:
    """Discounted visitation of each expert's cells, shape (N_E, n), each row of sum 1."""
    of_state = occupancy_measure(game, policy).sum(axis=1)
    cells = game.cells(np.arange(game.n_states))
    return np.stack([weighted_counts(own, of_state, game.n_cells) for own in cells])
