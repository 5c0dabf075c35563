"""One case with one seed: learn, judge every iteration, and keep what tables and pictures show."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mabirds_bringup.bench.comparison import SETTLED, Comparison
from mabirds_bringup.bench.results import CaseResult, MetricsRow, curve, entries, points
from mabirds_bringup.bench.study import Case
from mabirds_bringup.evaluate.held_out import HeldOut
from mabirds_bringup.evaluate.verdicts import Verdicts, verdicts
from mabirds_core.algorithm.memory import stacked
from mabirds_core.arrays import Mask
from mabirds_core.costs.models import costs_of
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Progress, Streams, simulate, simulate_central
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.judging import ImitationMetrics
from mabirds_core.games.truth import known_constraints, known_rates
from mabirds_core.games.whole_game import Game
from mabirds_core.metrics.constraints import by_threshold, constraint_errors
from mabirds_core.metrics.metrics import consensus_distance
from mabirds_expert_player.recorder import expert_streams

DIGITS = 6
"""Decimals of learned parameters in the results; far finer than any picture shows."""


class OwnPolicy(NamedTuple):
    """A policy that a learner planned.

    Attributes
    ----------
    rates : ImitationMetrics
        Its CVR and SR.
    gap : float or None
        By how much it earns less than V_0 says, in nats, where it knows.
    """

    rates: ImitationMetrics
    gap: float | None


@dataclass(frozen=True)
class LearnedCase:
    """One case with one seed, learned.

    Attributes
    ----------
    experiment, game, streams
        What was learned, and from what.
    history : History
        theta and omega of each learner or method.
    progress : Mapping
        Its updates, without policies, which fill the memory.
    own : Mapping
        Policies that learners planned, by name and iteration.
    peak_memory : float
        Of the process that learned [MB].
    """

    experiment: Experiment
    game: Game
    streams: Streams
    history: History
    progress: Mapping[str, Sequence[Progress]]
    own: Mapping[str, Mapping[int, OwnPolicy]]
    peak_memory: float


class Judged(NamedTuple):
    """What theta and omega of a learner mean.

    Attributes
    ----------
    rates : Mapping[int, ImitationMetrics]
        CVR and SR by iteration.
    nats : Mapping[int, float]
        Held-out log likelihood by iteration, where the game can say.
    policy : Any
        The last one.
    """

    rates: Mapping[int, ImitationMetrics]
    nats: Mapping[int, float]
    policy: Any


def run_case(case: Case, seed: int) -> list[CaseResult]:
    """Learn and judge.

    Parameters
    ----------
    case : Case
        What to learn.
    seed : int
        Of demonstrations and rollouts.

    Returns
    -------
    list of CaseResult
        One per learner. By iteration, also after closing rounds: ``violation_rate`` and ``success_rate`` of the
        policies that theta and omega mean; ``consensus_theta`` and ``consensus_omega``, largest distance of a learner
        of the case from their mean. By update: ``seconds``; ``actor_violation_rate``, ``actor_success_rate`` and
        ``actor_gap`` of policies that the learner planned, every ``judged_every``-th; ``late_actor_gap``, the largest
        after SETTLED. At the end: constraint errors by the threshold, work, ``peak_memory`` of the process with all
        learners of the case [MB], ``policy_distance``, largest total variation distance of two learners,
        ``same_constraints``, 1 where all learners have one constraint set, ``theta[k]``, ``omega[k]``, the game's own
        measures, what ``measures`` says of the behaviour and of constraints by the game's test, and what planners that
        took no part find (``_verdict_rows``).
    """
    learned = learn(case, case.seeded(seed))
    compared = Comparison.of(learned.experiment, learned.game, learned.streams, optimum=case.optimum)
    judged = {name: _judged(learned, name, case, compared.held_out) for name in learned.history}
    agreement = [*_agreement(learned, [of.policy for of in judged.values()], case.rollouts)]
    final = {name: parameters[-1] for name, parameters in learned.history.items()}
    told = verdicts(learned.experiment, learned.game, compared.held_out, final)
    results = []
    for name, of in judged.items():
        measured = compared.measures(name, learned.history[name][-1], of.policy, of.rates)
        last = len(learned.history[name]) - 1
        rows = [*_rows(learned, name, of), *agreement, *entries(last, **measured), *_verdict_rows(told[name], last)]
        results.append(CaseResult(case.group, case.label, name, seed, rows))
    return results


def drawn_streams(experiment: Experiment, game: Game) -> dict[str, list[Trajectories]]:
    """As many demonstrations for each learner as it learns from, drawn in memory."""
    streams = expert_streams(experiment, game)
    return {learner: list(islice(stream, experiment.iterations)) for learner, stream in streams.items()}


def learn(case: Case, experiment: Experiment) -> LearnedCase:
    """Demonstrations are drawn, and learned from by the case's method."""
    game = build_game(experiment)
    streams, progress = drawn_streams(experiment, game), defaultdict[str, list[Progress]](list)
    own = defaultdict[str, dict[int, OwnPolicy]](dict)

    def keep(update: Progress) -> None:
        progress[update.name].append(update._replace(policy=None))
        n, last = len(progress[update.name]) - 1, len(progress[update.name]) == experiment.iterations
        if case.own_policies and (last or n % case.judged_every == 0):
            rates = known_rates(game.judge, update.policy, experiment.seed, _rollouts(case.rollouts, last))
            gap = update.policy.gap(experiment.seed) if hasattr(update.policy, "gap") else None
            own[update.name][n] = OwnPolicy(rates, gap)

    if case.method:
        history = simulate_central(experiment, case.method, streams, keep)
    else:
        history = simulate(experiment, streams, keep)
    return LearnedCase(experiment, game, streams, history, progress, own, peak_memory())


def peak_memory() -> float:
    """Most memory of this process [MB]; resource.getrusage would count what its parent takes when it begins."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    kibibytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(kibibytes) * 1024 / 1e6


def _rollouts(rollouts: int | None, last: bool) -> int | None:  # noqa: FBT001
    return rollouts if rollouts is None or last else rollouts // 10


def _judged(learned: LearnedCase, name: str, case: Case, held_out: HeldOut) -> Judged:
    """The policies that theta and omega mean, by iteration."""
    experiment, game, parameters = learned.experiment, learned.game, learned.history[name]
    planned, rates, nats = evaluation_policy(experiment, name, game), dict[int, ImitationMetrics](), dict[int, float]()
    final = {experiment.iterations, len(parameters) - 1}
    for n in sorted({*range(0, len(parameters), case.judged_every), *final}):
        policy = planned(parameters[n])
        rates[n] = known_rates(game.judge, policy, experiment.seed, _rollouts(case.rollouts, n in final))
        if (likelihood := held_out.log_likelihood(game, policy)) is not None:
            nats[n] = likelihood
    return Judged(rates, nats, policy)


OF_JUDGES = {
    "judge_success": "success_rate",
    "judge_violation": "violation_rate",
    "judge_value": "value",
    "judge_gap": "certificate",
    "judge_nats": "held_out_log_likelihood",
    "judge_fixed": "fixed_log_likelihood",
}
"""Names of measures, and where a verdict has them."""


def _verdict_rows(found: Verdicts, last: int) -> Iterator[MetricsRow]:
    """By judging planner what verdicts have; of all of them the worst rates, and how far their V_0 are apart."""
    measures = {
        measure: {judge: value for judge, of in found.items() if (value := getattr(of, field)) is not None}
        for measure, field in OF_JUDGES.items()
    }
    yield from entries(last, **measures)
    if measures["judge_success"]:
        yield MetricsRow(last, "least_judge_success", min(measures["judge_success"].values()))
        yield MetricsRow(last, "most_judge_violation", max(measures["judge_violation"].values()))
    if values := measures["judge_value"].values():
        yield MetricsRow(last, "judge_value_range", max(values) - min(values))


def _agreement(learned: LearnedCase, policies: list[Any], rollouts: int | None) -> Iterator[MetricsRow]:
    """How far the learners of the case are apart, the same rows for each."""
    together = list(zip(*learned.history.values(), strict=True))
    yield from curve("consensus_theta", [consensus_distance([at.theta for at in learners]) for learners in together])
    yield from curve("consensus_omega", [consensus_distance([at.omega for at in learners]) for learners in together])
    masks = np.stack([_constraints(learned, name) for name in learned.history])
    distance = learned.game.judge.distance(policies, learned.experiment.seed, rollouts)
    yield from entries(len(together) - 1, policy_distance=distance, same_constraints=(masks == masks[0]).all())


def _constraints(learned: LearnedCase, name: str) -> Mask:
    omega = costs_of(learned.game).by_feature(learned.history[name][-1].omega)
    return by_threshold(omega, learned.experiment.constraint_threshold)


def _rows(learned: LearnedCase, name: str, judged: Judged) -> Iterator[MetricsRow]:
    progress, last, game = learned.progress[name], learned.history[name][-1], learned.game
    yield from _rates("", judged.rates)
    own = learned.own.get(name, {})
    yield from _rates("actor_", {n: of.rates for n, of in own.items()})
    gaps = {n: of.gap for n, of in own.items() if of.gap is not None}
    yield from points("actor_gap", gaps)
    if late := [gap for n, gap in gaps.items() if n > SETTLED]:
        yield MetricsRow(max(gaps), "late_actor_gap", max(late))
    yield from points("held_out_nats", judged.nats)
    yield from curve("seconds", [update.seconds for update in progress], first=1)
    yield from entries(
        max(judged.rates),
        **constraint_errors(_constraints(learned, name), known_constraints(game))._asdict(),
        **progress[-1].work._asdict(),
        peak_memory=learned.peak_memory,
        theta=np.round(last.theta, DIGITS),
        omega=np.round(last.omega, DIGITS),
        **game.measures(last.omega, stacked([shown for stream in learned.streams.values() for shown in stream])),
    )


def _rates(whose: str, rates: Mapping[int, ImitationMetrics]) -> Iterator[MetricsRow]:
    yield from points(f"{whose}violation_rate", {n: rate.violation_rate for n, rate in rates.items()})
    yield from points(f"{whose}success_rate", {n: rate.success_rate for n, rate in rates.items()})
