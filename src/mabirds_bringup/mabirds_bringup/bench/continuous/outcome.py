"""One case with one seed: learn, judge every iteration by flights, and keep what tables and figures show."""

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mabirds_bringup.bench.cases import Case
from mabirds_bringup.bench.learning import Streams, drawn_streams, learn
from mabirds_core.algorithm.gradient import stacked
from mabirds_core.arrays import Array
from mabirds_core.experiment.assembly import policy_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Progress
from mabirds_core.games.drones.learned_costs import closeness_costs, flown_costs, pillar_costs
from mabirds_core.games.drones.metrics import drone_imitation, flight_distance, place_visitation
from mabirds_core.games.drones.planner_settings import SoftActorCriticSettings
from mabirds_core.games.drones.study import drone_game, flights_of
from mabirds_core.games.drones.whole_game import WholeDroneGame
from mabirds_core.games.interface import Imitation, Trajectories
from mabirds_core.metrics.metrics import consensus_distance

FLIGHTS = 2000
"""That judge a policy after the last update, and after the closing rounds; a tenth of them after every other."""

SHOWN_FLIGHTS = 15
DIGITS = 6
"""Decimals of costs and places in the results; far finer than any figure shows."""


@dataclass(frozen=True)
class Outcome:
    """What one learner or central method came to; rates in [0, 1]; entry k of a list: after k updates."""

    group: str
    label: str
    learner: str
    seed: int
    violation_rate: list[float]
    """Of the policies that theta and omega mean; past the updates: after each closing round."""
    success_rate: list[float]
    actor_violation_rate: list[float]
    """Of the policies that the learner itself found, where those are networks; else empty."""
    actor_success_rate: list[float]
    seconds: list[float]
    gradient_steps: int
    policy_solves: int
    peak_memory: float
    """Of the process that learned, with all learners of the case [MB]."""
    omega: list[float]
    flights: list[list[list[list[float]]]]
    """Some flights of the last policy: places [m], (SHOWN_FLIGHTS, T + 1, N_E, 2)."""
    pillar_inside: list[list[float]]
    """Mean learned cost of where a drone would touch a pillar, (N_E, pillars)."""
    pillar_rim: list[list[float]]
    flown: list[float]
    """Mean learned cost along the demonstrations, (N_E,)."""
    closeness: list[float]
    """By how much distances below the least cost more than that of drones far apart, (pairs,)."""
    consensus_theta: list[float]
    """Largest distance of a learner of the case from their mean."""
    consensus_omega: list[float]
    policy_distance: float
    """Largest total variation distance of two learners' flights, in [0, 1]."""


@dataclass(frozen=True)
class Judgement:
    """A learner's policies by iteration, and the flights of the last."""

    imitations: list[Imitation]
    flights: Trajectories


@dataclass(frozen=True)
class Agreement:
    """How far the learners of a case are apart."""

    theta: list[float]
    omega: list[float]
    policy: float


@dataclass(frozen=True)
class _Case:
    """One case with one seed, learned."""

    case: Case
    experiment: Experiment
    game: WholeDroneGame
    streams: Streams
    history: History
    progress: dict[str, list[Progress]]
    actors: dict[str, list[Imitation]]
    peak_memory: float
    flights: int


def run_case(case: Case, seed: int, flights: int = FLIGHTS) -> list[Outcome]:
    """One outcome a learner; its last policies are judged by so many ``flights``, others by a tenth of them."""
    learned = _learned(case, case.seeded(seed), flights)
    judgements = {name: _judgement(learned, name) for name in learned.history}
    agreement = _agreement(learned, list(judgements.values()))
    return [_outcome(learned, name, one, agreement) for name, one in judgements.items()]


def _learned(case: Case, experiment: Experiment, flights: int) -> _Case:
    game = drone_game(experiment)
    streams, actors = drawn_streams(experiment, game), defaultdict[str, list[Imitation]](list)
    networks = isinstance(experiment.algorithm.policy, SoftActorCriticSettings)

    def judge_actor(one: Progress) -> None:  # now, because policies are too large to be kept
        own = actors[one.name]
        count = flights if len(own) == experiment.iterations - 1 else flights // 10
        own.append(drone_imitation(game, flights_of(experiment, game, one.policy, count)))

    learned = learn(case, experiment, streams, judge_actor if networks else lambda _: None)
    return _Case(case, experiment, game, streams, *learned, actors, peak_memory(), flights)


def peak_memory() -> float:
    """Of this process [MB]. Not of resource.getrusage, where a new process begins with what its parent takes."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    kibibytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(kibibytes) * 1024 / 1e6


def _judgement(learned: _Case, name: str) -> Judgement:
    """Of the policies that theta and omega mean."""
    experiment, game, parameters = learned.experiment, learned.game, learned.history[name]
    policy, imitations = policy_of(experiment, name, game), list[Imitation]()
    for updates, one in enumerate(parameters):
        last = updates in {experiment.iterations, len(parameters) - 1}
        flights = flights_of(experiment, game, policy(one), learned.flights if last else learned.flights // 10)
        imitations.append(drone_imitation(game, flights))
    return Judgement(imitations, flights)


def _agreement(learned: _Case, judgements: list[Judgement]) -> Agreement:
    together = list(zip(*learned.history.values(), strict=True))
    return Agreement(
        [consensus_distance([one.theta for one in ones]) for ones in together],
        [consensus_distance([one.omega for one in ones]) for ones in together],
        flight_distance([place_visitation(learned.game, one.flights) for one in judgements]),
    )


def _outcome(learned: _Case, name: str, judgement: Judgement, agreement: Agreement) -> Outcome:
    game, omega, actors = learned.game, learned.history[name][-1].omega, learned.actors.get(name, [])
    inside, rim = pillar_costs(game, omega)
    demonstrations = stacked([one for stream in learned.streams.values() for one in stream])
    return Outcome(
        learned.case.group,
        learned.case.label,
        name,
        learned.experiment.seed,
        *_rates(judgement.imitations),
        *_rates(actors),
        [one.seconds for one in learned.progress[name]],
        *learned.progress[name][-1].work,
        learned.peak_memory,
        _rounded(omega),
        _rounded(game.positions(judgement.flights.states[:SHOWN_FLIGHTS])),
        _rounded(inside),
        _rounded(rim),
        _rounded(flown_costs(game, omega, demonstrations)),
        _rounded(closeness_costs(game, omega)),
        agreement.theta,
        agreement.omega,
        agreement.policy,
    )


def _rates(imitations: list[Imitation]) -> tuple[list[float], list[float]]:
    return [one.violation_rate for one in imitations], [one.success_rate for one in imitations]


def _rounded(values: Array) -> list[Any]:
    return list(np.round(values, DIGITS).tolist())
