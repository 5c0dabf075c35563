"""One case with one seed: learn, judge every iteration, and keep what tables and pictures show."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from mabirds_bringup.bench.comparison import Comparison
from mabirds_bringup.bench.results import CaseResult, MetricsRow, curve, entries
from mabirds_bringup.bench.study import Case
from mabirds_core.algorithm.memory import stacked
from mabirds_core.arrays import Mask
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Progress, Streams, simulate, simulate_central
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.whole_game import Game, ImitationMetrics
from mabirds_core.metrics.constraints import by_threshold, constraint_errors
from mabirds_core.metrics.metrics import consensus_distance
from mabirds_expert_player.recorder import expert_streams

DIGITS = 6
"""Decimals of learned parameters in the results; far finer than any picture shows."""


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
    own_rates : Mapping
        CVR and SR of the policies that it planned itself, where they were asked for.
    peak_memory : float
        Of the process that learned [MB].
    """

    experiment: Experiment
    game: Game
    streams: Streams
    history: History
    progress: Mapping[str, Sequence[Progress]]
    own_rates: Mapping[str, list[ImitationMetrics]]
    peak_memory: float


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
        of the case from their mean. By update: ``seconds``; ``actor_violation_rate`` and ``actor_success_rate`` of the
        policies that the learner planned. At the end: constraint errors by the threshold, work, ``peak_memory`` of the
        process with all learners of the case [MB], ``policy_distance``, largest total variation distance of two
        learners, ``same_constraints``, 1 where all learners have one constraint set, ``theta[k]``, ``omega[k]``, the
        game's own measures, and what ``measures`` says of the behaviour and of constraints by the game's test.
    """
    learned = learn(case, case.seeded(seed))
    judged = {name: _judged(learned, name, case.rollouts) for name in learned.history}
    agreement = [*_agreement(learned, [policy for _, policy in judged.values()], case.rollouts)]
    compared = Comparison.of(
        learned.experiment, learned.game, learned.streams, optimum=case.optimum, independent=case.independent
    )
    results = []
    for name, (rates, policy) in judged.items():
        last = learned.history[name][-1]
        measured = compared.measures(name, last, policy, rates)
        judged_by_others = compared.judged(name, last, case.rollouts) if case.independent else {}
        at_end = entries(len(rates) - 1, **measured, **judged_by_others, **_worst(judged_by_others))
        rows = [*_rows(learned, name, rates), *agreement, *at_end]
        results.append(CaseResult(case.group, case.label, name, seed, rows))
    return results


def _worst(judged: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """What the strictest of the other planners says, and by how much their values differ."""
    if not judged.get("judged_success"):
        return {}
    success, violation, values = (judged[f"judged_{measure}"].values() for measure in ("success", "violation", "value"))
    spread = max(values) - min(values)
    return {"least_judged": min(success), "most_judged_violation": max(violation), "judged_spread": spread}


def drawn_streams(experiment: Experiment, game: Game) -> dict[str, list[Trajectories]]:
    """As many demonstrations for each learner as it learns from, drawn in memory."""
    streams = expert_streams(experiment, game)
    return {learner: list(islice(stream, experiment.iterations)) for learner, stream in streams.items()}


def learn(case: Case, experiment: Experiment) -> LearnedCase:
    """Demonstrations are drawn, and learned from by the case's method."""
    game = build_game(experiment)
    streams, progress = drawn_streams(experiment, game), defaultdict[str, list[Progress]](list)
    own_rates = defaultdict[str, list[ImitationMetrics]](list)

    def keep(update: Progress) -> None:
        progress[update.name].append(update._replace(policy=None))
        if case.own_policies:
            count = _rollouts(case.rollouts, len(progress[update.name]) == experiment.iterations)
            own_rates[update.name].append(game.judge.imitation(update.policy, experiment.seed, count))

    if case.method:
        history = simulate_central(experiment, case.method, streams, keep)
    else:
        history = simulate(experiment, streams, keep)
    return LearnedCase(experiment, game, streams, history, progress, own_rates, peak_memory())


def peak_memory() -> float:
    """Most memory of this process [MB]; resource.getrusage would count what its parent takes when it begins."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    kibibytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(kibibytes) * 1024 / 1e6


def _rollouts(rollouts: int | None, last: bool) -> int | None:  # noqa: FBT001
    return rollouts if rollouts is None or last else rollouts // 10


def _judged(learned: LearnedCase, name: str, rollouts: int | None) -> tuple[list[ImitationMetrics], Any]:
    """CVR and SR of the policies that theta and omega mean, by iteration, and the last of them."""
    experiment, game, parameters = learned.experiment, learned.game, learned.history[name]
    planned, rates = evaluation_policy(experiment, name, game), list[ImitationMetrics]()
    for updates, at in enumerate(parameters):
        policy, last = planned(at), updates in {experiment.iterations, len(parameters) - 1}
        rates.append(game.judge.imitation(policy, experiment.seed, _rollouts(rollouts, last)))
    return rates, policy


def _agreement(learned: LearnedCase, policies: list[Any], rollouts: int | None) -> Iterator[MetricsRow]:
    """How far the learners of the case are apart, the same rows for each."""
    together = list(zip(*learned.history.values(), strict=True))
    yield from curve("consensus_theta", [consensus_distance([at.theta for at in learners]) for learners in together])
    yield from curve("consensus_omega", [consensus_distance([at.omega for at in learners]) for learners in together])
    masks = np.stack([_constraints(learned, name) for name in learned.history])
    distance = learned.game.judge.distance(policies, learned.experiment.seed, rollouts)
    yield from entries(len(together) - 1, policy_distance=distance, same_constraints=(masks == masks[0]).all())


def _constraints(learned: LearnedCase, name: str) -> Mask:
    return by_threshold(learned.history[name][-1].omega, learned.experiment.constraint_threshold)


def _rows(learned: LearnedCase, name: str, rates: list[ImitationMetrics]) -> Iterator[MetricsRow]:
    progress, last, game = learned.progress[name], learned.history[name][-1], learned.game
    yield from _rates("", rates)
    yield from _rates("actor_", learned.own_rates.get(name, []))
    yield from curve("seconds", [update.seconds for update in progress], first=1)
    yield from entries(
        len(rates) - 1,
        **constraint_errors(_constraints(learned, name), game.true_constraints)._asdict(),
        **progress[-1].work._asdict(),
        peak_memory=learned.peak_memory,
        theta=np.round(last.theta, DIGITS),
        omega=np.round(last.omega, DIGITS),
        **game.measures(last.omega, stacked([shown for stream in learned.streams.values() for shown in stream])),
    )


def _rates(whose: str, rates: list[ImitationMetrics]) -> Iterator[MetricsRow]:
    yield from curve(f"{whose}violation_rate", [rate.violation_rate for rate in rates])
    yield from curve(f"{whose}success_rate", [rate.success_rate for rate in rates])
