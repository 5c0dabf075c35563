"""One case with one seed: learn, judge every iteration by flights, and keep what tables and figures show."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mabirds_bringup.bench.cases import Case
from mabirds_bringup.bench.learning import Streams, drawn_streams, learn
from mabirds_bringup.bench.results import CaseResult, MetricsRow, curve, entries
from mabirds_core.algorithm.memory import stacked
from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.experiment.assembly import evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Progress
from mabirds_core.games.drones.learned_costs import closeness_costs, obstacle_costs, trajectory_costs
from mabirds_core.games.drones.metrics import drone_imitation, place_visitation, visitation_distance
from mabirds_core.games.drones.planner_settings import SoftActorCriticSettings
from mabirds_core.games.drones.study import drone_game, eval_rollouts
from mabirds_core.games.drones.whole_game import WholeDroneGame
from mabirds_core.games.interface import ImitationMetrics, Trajectories
from mabirds_core.metrics.metrics import consensus_distance

FLIGHTS = 2000
"""Flights that judge a policy after the last update and the closing rounds; a tenth of them after every other."""

SHOWN_FLIGHTS = 15
DIGITS = 6
"""Decimals of costs and places in the results; far finer than any figure shows."""


@dataclass(frozen=True)
class Judgement:
    """A learner's policies by iteration, and the flights of the last."""

    imitations: list[ImitationMetrics]
    flights: Trajectories


@dataclass(frozen=True)
class LearnedCase:
    """One case with one seed, learned."""

    experiment: Experiment
    game: WholeDroneGame
    streams: Streams
    history: History
    progress: dict[str, list[Progress]]
    actors: dict[str, list[ImitationMetrics]]
    peak_memory: float
    flights: int


def run_case(case: Case, seed: int, flights: int = FLIGHTS) -> list[CaseResult]:
    """One result per learner; its last policies are judged by so many ``flights``, others by a tenth of them.

    Rates in [0, 1]: ``violation_rate`` and ``success_rate`` of the policies that theta and omega mean, also after each
    closing round; ``actor_violation_rate`` and ``actor_success_rate`` of those that the learner itself found from theta
    and omega of the iteration, where those are networks. ``consensus_theta``, ``consensus_omega``: largest distance of
    a learner of the case from their mean; ``policy_distance``: largest total variation distance of two learners'
    flights, in [0, 1]. ``peak_memory``: of the process that learned, with all learners of the case [MB].

    Of the last parameters: ``omega[k]``; ``flights[j,t,i,x]``, places [m] of some flights, (SHOWN_FLIGHTS, T + 1, N_E,
    2); ``pillar_inside[i,p]`` and ``pillar_rim[i,p]``, mean learned cost of where a drone would touch a pillar and of
    that disc's rim; ``flown[i]``, mean learned cost along the demonstrations; ``pillar_dearer[i,p]``, do both cost more
    than that; ``closeness[pair]``, by how much distances below the least cost more than that of drones far apart.
    """
    learned = _learned(case, case.seeded(seed), flights)
    judgements = {name: _judgement(learned, name) for name in learned.history}
    agreement = list(_agreement(learned, list(judgements.values())))
    return [
        CaseResult(case.group, case.label, name, seed, [*_rows(learned, name, judgement), *agreement])
        for name, judgement in judgements.items()
    ]


def _learned(case: Case, experiment: Experiment, flights: int) -> LearnedCase:
    game = drone_game(experiment)
    streams, actors = drawn_streams(experiment, game), defaultdict[str, list[ImitationMetrics]](list)
    networks = isinstance(experiment.algorithm.policy, SoftActorCriticSettings)

    def judge_actor(update: Progress) -> None:  # now, because policies are too large to be kept
        own = actors[update.name]
        count = flights if len(own) == experiment.iterations - 1 else flights // 10
        own.append(drone_imitation(game, eval_rollouts(experiment, game, update.policy, count)))

    learned = learn(case, experiment, streams, judge_actor if networks else lambda _: None)
    return LearnedCase(experiment, game, streams, *learned, actors, peak_memory(), flights)


def peak_memory() -> float:
    """Most memory of this process [MB]; resource.getrusage would count what its parent takes when it begins."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    kibibytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(kibibytes) * 1024 / 1e6


def _judgement(learned: LearnedCase, name: str) -> Judgement:
    """Judgement of the policies that theta and omega mean."""
    experiment, game, parameters = learned.experiment, learned.game, learned.history[name]
    policy, imitations = evaluation_policy(experiment, name, game), list[ImitationMetrics]()
    for updates, known in enumerate(parameters):
        last = updates in {experiment.iterations, len(parameters) - 1}
        flights = eval_rollouts(experiment, game, policy(known), learned.flights if last else learned.flights // 10)
        imitations.append(drone_imitation(game, flights))
    return Judgement(imitations, flights)


def _agreement(learned: LearnedCase, judgements: list[Judgement]) -> Iterator[MetricsRow]:
    """How far the learners of the case are apart, the same rows for each."""
    together = list(zip(*learned.history.values(), strict=True))
    yield from curve(
        "consensus_theta", [consensus_distance([known.theta for known in at_once]) for at_once in together]
    )
    yield from curve(
        "consensus_omega", [consensus_distance([known.omega for known in at_once]) for at_once in together]
    )
    places = [place_visitation(learned.game, judgement.flights) for judgement in judgements]
    yield from entries(len(together) - 1, policy_distance=visitation_distance(places))


def _rows(learned: LearnedCase, name: str, judgement: Judgement) -> Iterator[MetricsRow]:
    progress, omega = learned.progress[name], learned.history[name][-1].omega
    yield from _rates("", judgement.imitations)
    yield from _rates("actor_", learned.actors.get(name, []))
    yield from curve("seconds", [update.seconds for update in progress], first=1)
    numbers = {"peak_memory": learned.peak_memory, **progress[-1].work._asdict()}
    shown = learned.game.positions(judgement.flights.states[:SHOWN_FLIGHTS])
    arrays = {"omega": omega, "flights": shown, **costs_of(learned.game, omega, learned.streams)}
    rounded = {metric: np.round(values, DIGITS) for metric, values in arrays.items()}
    yield from entries(len(judgement.imitations) - 1, **numbers, **rounded, pillar_dearer=dear_pillars(rounded))


def _rates(whose: str, imitations: list[ImitationMetrics]) -> Iterator[MetricsRow]:
    yield from curve(f"{whose}violation_rate", [imitation.violation_rate for imitation in imitations])
    yield from curve(f"{whose}success_rate", [imitation.success_rate for imitation in imitations])


def costs_of(game: WholeDroneGame, omega: Vector, streams: Streams) -> dict[str, Array]:
    """What omega costs: ``pillar_inside``, ``pillar_rim`` (N_E, pillars), ``flown`` (N_E,), ``closeness`` (pairs,)."""
    inside, rim = obstacle_costs(game, omega)
    demonstrations = stacked([trajectories for stream in streams.values() for trajectories in stream])
    return {
        "pillar_inside": inside,
        "pillar_rim": rim,
        "flown": trajectory_costs(game, omega, demonstrations),
        "closeness": closeness_costs(game, omega),
    }


def dear_pillars(costs: Mapping[str, Array]) -> Mask:
    """Do touching a pillar and its rim each cost more than the ways that a drone flew? (N_E, pillars)."""
    return np.minimum(costs["pillar_inside"], costs["pillar_rim"]) > costs["flown"][:, None]
