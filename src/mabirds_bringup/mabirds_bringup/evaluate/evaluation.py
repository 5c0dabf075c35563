"""From the learners' parameters to numbers: what each policy would do, and what it took for a constraint."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np

from mabirds_bringup.evaluate.constraints import Constraints, learned_constraints
from mabirds_bringup.evaluate.held_out import HeldOut
from mabirds_bringup.evaluate.parallel import judge_all
from mabirds_bringup.evaluate.policies import LearnerMetrics, PolicyJudge, Task
from mabirds_bringup.evaluate.verdicts import Verdict, Verdicts, asked_of, assembled
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Streams
from mabirds_core.games.whole_game import Game
from mabirds_core.metrics.constraints import (
    ConstraintErrors,
    surest_first,
)
from mabirds_core.metrics.curves import first_at, late_mean, late_minimum, stays_from
from mabirds_core.metrics.metrics import consensus_distance
from mabirds_core.planners.interface import Policy

OnJudged = Callable[[LearnerMetrics | None], None]
"""Called with each row, and with None for each verdict."""

LEVEL = 0.9
"""Success rate from which on the time is told."""


@dataclass(frozen=True)
class Evaluation:
    """Rows by learner and iteration, what was learned in the end, and the consensus distances by iteration.

    ``policies``: what each learner or method ended with.
    """

    rows: list[LearnerMetrics]
    consensus_theta: list[float]
    consensus_omega: list[float]
    consensus_policy: float
    constraints: dict[str, Constraints]
    expert_log_likelihood: float | None
    occupancy_distance: dict[str, float | None]
    fixed_log_likelihoods: Mapping[str, float]
    verdicts: Mapping[str, Verdicts]
    policies: Mapping[str, Policy]

    def of(self, learner: str) -> list[LearnerMetrics]:
        """A learner's rows in order."""
        return [row for row in self.rows if row.learner == learner]


def evaluate(
    experiment: Experiment,
    history: History,
    demonstrations: Streams,
    on_judged: OnJudged = lambda _: None,
    judged: Sequence[LearnerMetrics] = (),
    judge: PolicyJudge | None = None,
    tasks: Sequence[Task] | None = None,
) -> Evaluation:
    """Judge theta(n), omega(n) of all learners by the game's judge; in parallel, where that takes long.

    Parameters
    ----------
    experiment : Experiment
        What was learned.
    history : History
        theta and omega of each learner or method.
    demonstrations : Streams
        Each learner's, from which it learned; empty where they are not at hand.
    on_judged : Callable
        Called with each iteration that was judged, and with None for each verdict of another planner.
    judged : Sequence
        What is known already: of judging while it was learned, or of an evaluation that was interrupted.
    judge : PolicyJudge, optional
        Of the experiment, where one is ready.
    tasks : Sequence[Task], optional
        Those of ``tasks_of`` that are to be judged; None: all.

    Returns
    -------
    Evaluation
        Exact or sampled, as the game's judge says.
    """
    judge = judge or PolicyJudge(experiment)
    game, held_out, final = judge.game, judge.held_out, {name: of[-1] for name, of in history.items()}
    finals = judge_finals(judge, final, demonstrations, _updates(experiment, history))
    told = _told(judge, tasks_of(judge, history) if tasks is None else tasks, judged, on_judged)
    together = list(zip(*history.values(), strict=False))
    return Evaluation(
        [*told.rows.values()],
        [consensus_distance([learner.theta for learner in learners]) for learners in together],
        [consensus_distance([learner.omega for learner in learners]) for learners in together],
        finals.apart,
        finals.constraints,
        held_out.log_likelihood(game, held_out.experts),
        finals.from_experts,
        held_out.fixed_log_likelihoods(game, next(iter(finals.policies.values()))),
        assembled(experiment, final, told.verdicts),
        finals.policies,
    )


class Finals(NamedTuple):
    """What is found of the last parameters alone.

    Attributes
    ----------
    policies : Mapping[str, Policy]
        By learner or method.
    apart : float
        Largest distance between two of them.
    constraints : dict[str, Constraints]
        By learner or method.
    from_experts : dict[str, float or None]
        Distances, by learner or method.
    """

    policies: Mapping[str, Policy]
    apart: float
    constraints: dict[str, Constraints]
    from_experts: dict[str, float | None]


def _updates(experiment: Experiment, history: History) -> int:
    """Of all learners together: fewer than the experiment has where a run was interrupted or a learner has left."""
    return sum(min(len(history[name]) - 1, experiment.iterations) for name in experiment.learners if name in history)


def judge_finals(
    judge: PolicyJudge, final: Mapping[str, Parameters], demonstrations: Streams, updates: int | None = None
) -> Finals:
    """Judge what learners ended with; a second time costs little, since the judge keeps what takes long.

    Parameters
    ----------
    judge : PolicyJudge
        Of the experiment.
    final : Mapping[str, Parameters]
        theta and omega by learner or method.
    demonstrations : Streams
        Each learner's.
    updates : int, optional
        Made by all learners together, with a demonstration each; None: all of the experiment.

    Returns
    -------
    Finals
        Of all.
    """
    experiment, game, policies = judge.experiment, judge.game, judge.policies(final)
    whole = updates in {None, len(experiment.learners) * experiment.iterations}  # else learners may know of others
    return Finals(
        policies,
        game.judge.distance([*policies.values()], experiment.seed),
        {
            name: learned_constraints(
                experiment,
                name,
                last,
                demonstrations,
                game,
                updates,
                judge.told_confidences(name, last) if whole else None,
            )
            for name, last in final.items()
        },
        {name: distance_to_experts(experiment, game, policy, judge.held_out) for name, policy in policies.items()},
    )


def tasks_of(judge: PolicyJudge, history: History) -> list[Task]:
    """What is judged of a history.

    Parameters
    ----------
    judge : PolicyJudge
        Of the experiment.
    history : History
        theta and omega of each learner or method.

    Returns
    -------
    list[Task]
        Verdicts of other planners on the last parameters, which take longest, then rows by learner and iteration.
    """
    final = {name: parameters[-1] for name, parameters in history.items()}
    verdicts = [
        Task(name, len(history[name]), final[name], planner)
        for name, planner in asked_of(judge.experiment, judge.game, final)
    ]
    judged = judge.game.judge.eval_iterations
    rows = [Task(name, n, of[n - 1]) for name, of in history.items() for n in judged(len(of))]
    return [*verdicts, *rows]


class _Told(NamedTuple):
    """By learner and iteration, and by learner and planner."""

    rows: dict[tuple[str, int], LearnerMetrics]
    verdicts: dict[tuple[str, str], Verdict]


def _told(judge: PolicyJudge, tasks: Sequence[Task], known: Sequence[LearnerMetrics], on_judged: OnJudged) -> _Told:
    """Judge what is not known."""
    rows, verdicts = {(row.learner, row.iteration): row for row in known}, dict[tuple[str, str], Verdict]()
    new = judge_all(judge, [task for task in tasks if task.planner or task.row not in rows])
    for task in tasks:
        if task.planner:
            verdicts[task.learner, task.planner] = cast("Verdict", next(new))
        elif task.row not in rows:
            rows[task.row] = cast("LearnerMetrics", next(new))
        on_judged(None if task.planner else rows[task.row])
    return _Told({task.row: rows[task.row] for task in tasks if not task.planner}, verdicts)


def distance_to_experts(experiment: Experiment, game: Game, policy: Any, held_out: HeldOut) -> float | None:
    """Total variation distance to what experts do, or to what they show; None where that cannot be said."""
    if held_out.experts is not None:
        return game.judge.distance([policy, held_out.experts], experiment.seed)
    if held_out.demonstrations is None:
        return None
    return game.judge.distance_to(policy, held_out.demonstrations, experiment.seed)


def summary(experiment: Experiment, evaluation: Evaluation, seconds: float) -> dict[str, Any]:
    """What summary.json holds. ``seconds``: wall time of the run."""
    game = build_game(experiment)
    return {
        "experiment": experiment.name,
        "constraint_rule": constraint_rule(experiment, evaluation),
        "rates": game.judge.method,
        "expert_log_likelihood": evaluation.expert_log_likelihood,
        "fixed_log_likelihoods": evaluation.fixed_log_likelihoods,
        "learners": {
            name: _learner_summary(experiment, evaluation, name, game.cost_features.names)
            for name in evaluation.constraints
        },
        "consensus_distance": {
            "theta": evaluation.consensus_theta[-1],
            "omega": evaluation.consensus_omega[-1],
            "policy": evaluation.consensus_policy,
        },
        "wall_seconds": seconds,
    }


def constraint_rule(experiment: Experiment, evaluation: Evaluation) -> str:
    """How constraints are told, for people."""
    if any(constraints.confidences is not None for constraints in evaluation.constraints.values()):
        return f"counterfactual test at confidence {experiment.constraint_confidence:g}"
    return f"learned cost -omega > {experiment.constraint_threshold:g}"


def _learner_summary(
    experiment: Experiment, evaluation: Evaluation, name: str, features: Sequence[str]
) -> Mapping[str, Any]:
    rows, constraints = evaluation.of(name), evaluation.constraints[name]
    return {
        "iterations": min(rows[-1].iteration - 1, experiment.iterations),
        "violation_rate": rows[-1].violation_rate,
        "success_rate": rows[-1].success_rate,
        **_success_over_time(rows),
        "held_out_log_likelihood": rows[-1].held_out_log_likelihood,
        "certificate": max((row.certificate for row in rows if row.certificate is not None), default=None),
        "occupancy_distance": evaluation.occupancy_distance[name],
        "judges": {judge: verdict._asdict() for judge, verdict in evaluation.verdicts[name].items()},
        **(dict.fromkeys(ConstraintErrors._fields) if constraints.errors is None else constraints.errors._asdict()),
        "auc": constraints.auc,
        "learned_constraints": _named(experiment, features, constraints),
        "undetermined": _undetermined(constraints),
    }


def _success_over_time(rows: Sequence[LearnerMetrics]) -> Mapping[str, float | None]:
    """How success rates end, and since when; None each where nobody knows the truth."""
    success = [row.success_rate for row in rows if row.success_rate is not None]
    first, settled = first_at(success, LEVEL), stays_from(success, LEVEL)
    return {
        "success_late_mean": late_mean(success) if success else None,
        "success_late_minimum": late_minimum(success) if success else None,
        "success_first_iteration": None if first is None else rows[first].iteration,
        "success_stays_from_iteration": None if settled is None else rows[settled].iteration,
    }


def _named(experiment: Experiment, features: Sequence[str], constraints: Constraints) -> Mapping[str, float | None]:
    """Learned constraints by name, surest first, each with its confidence; those of the threshold have none."""
    if constraints.confidences is None:
        return {features[int(k)]: None for k in np.flatnonzero(constraints.learned)}
    return surest_first(features, constraints.confidences, experiment.constraint_confidence)


def _undetermined(constraints: Constraints) -> int | None:
    """Features that were never shown, and that the demonstrations cannot tell of; None without a test."""
    if constraints.confidences is None:
        return None
    return int(((constraints.confidences >= 0) & ~constraints.learned).sum())
