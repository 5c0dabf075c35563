"""One random problem learned by each method, and all measures of it."""

from collections.abc import Iterator, Sequence
from typing import Any

from mabirds_bringup.bench.behaviour.counting import COUNTED_AT, counting_scores
from mabirds_bringup.bench.behaviour.draw import Draw, draw, with_paper_steps
from mabirds_bringup.bench.comparison import decidable_constraints
from mabirds_bringup.bench.pooled import policy_of, pooled_optimum
from mabirds_bringup.evaluate.constraints import learned_constraints
from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Mask, Vector
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, simulate, simulate_central
from mabirds_core.games.interface import Trajectories, shown_features
from mabirds_core.games.judging import ImitationMetrics
from mabirds_core.games.tabular.decidable import touch_without
from mabirds_core.games.truth import known_constraints, known_rates
from mabirds_core.metrics.constraints import by_threshold, constraint_errors, ranking_auc
from mabirds_core.metrics.curves import LATE, late_mean, late_minimum
from mabirds_core.metrics.likelihood import log_likelihoods

LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Confidences at which constraints are counted, beside the experiment's: what any choice of it would give."""

MABIRDS, PAPER, COUNTING = "MA-BIRDS", "paper's steps", "never visited"

Row = dict[str, Any]


def run_trial(seed: int, game_kind: str, methods: Sequence[str], demonstrations: int) -> list[Row]:
    """One row per method and learner of the problem with this seed.

    ``methods``: central ones that learn beside, and the paper's steps with them.
    """
    problem = draw(seed, game_kind, demonstrations)
    experiment, game = problem.experiment, tabular_game(problem.experiment)
    optimum = pooled_optimum(game, problem.pooled, problem.held_out)
    experts = game.experts("soft", "by_start").policy
    common = {
        "seed": seed,
        "game": experiment.game.model_dump_json(exclude_defaults=True),
        "experts": game.n_experts,
        "learners": len(experiment.learners),
        "schedule": experiment.schedule.kind,
        "demonstrations": demonstrations,
        "pooled_nats": optimum.final,
        "pooled_best_nats": optimum.best,
        "pooled_best_success": known_rates(game.judge, policy_of(game, optimum.stopped), 0).success_rate,
        "expert_nats": float(log_likelihoods(game, experts, problem.held_out).mean()),
    }
    judged = _Judged(problem, game, experts, touch_without(game))
    rows = [*judged.rows(MABIRDS, experiment, simulate(experiment, problem.streams)), *judged.counting()]
    if methods:
        paper = with_paper_steps(experiment)
        rows += judged.rows(PAPER, paper, simulate(paper, problem.streams))
    for method in methods:
        rows += judged.rows(method, experiment, simulate_central(experiment, method, problem.streams))
    return [{**common, **row} for row in rows]


def tabular_game(experiment: Experiment) -> Any:
    """The experiment's game; raises ExperimentError where it cannot be enumerated."""
    game = build_game(experiment)
    if not hasattr(game, "successor"):
        raise ExperimentError(f"game {experiment.game.kind}: expected one that can be enumerated")
    return game


def _worst(rates: Sequence[ImitationMetrics], count: int) -> Row:
    """The least successful of the last iterates: its number, and how often its policy violates or comes too late."""
    worst = min(range(len(rates)), key=lambda k: rates[k].success_rate)
    success, violation = rates[worst].success_rate, rates[worst].violation_rate
    return {
        "worst_iteration": count - len(rates) + worst + 1,
        "worst_violation": violation,
        "worst_too_late": 1 - success - violation,
    }


class _Judged:
    """Measures of one problem."""

    def __init__(self, problem: Draw, game: Any, experts: Any, touch: Vector) -> None:
        self._problem, self._game, self._experts, self._touch = problem, game, experts, touch

    def rows(self, method: str, experiment: Experiment, history: History) -> Iterator[Row]:
        """Of every learner, or of the central method."""
        for name, parameters in history.items():
            own = self._problem.streams.get(name)
            shown = self._problem.pooled if own is None else stacked(own)
            yield {
                "method": method,
                "learner": name,
                **self._behaviour(experiment, name, parameters),
                **self._constraints(experiment, name, parameters[-1], shown),
            }

    def counting(self) -> Iterator[Row]:
        """The rule that learns nothing: what was never visited is forbidden, as often as one stood beside it."""
        for name, stream in self._problem.streams.items():
            scores = counting_scores(self._game, stacked(stream))
            learned = scores >= COUNTED_AT
            yield {"method": COUNTING, "learner": name, **self._errors(learned, scores, stacked(stream))}

    def _behaviour(self, experiment: Experiment, name: str, parameters: list[Parameters]) -> Row:
        game, policy_of = self._game, evaluation_policy(experiment, name, self._game)
        policies = [policy_of(step) for step in parameters[-LATE:]]
        rates = [known_rates(game.judge, policy, 0) for policy in policies]
        success = [rate.success_rate for rate in rates]
        return {
            "success": success[-1],
            "violation": rates[-1].violation_rate,
            "late_mean": late_mean(success),
            "late_minimum": late_minimum(success),
            **_worst(rates, len(parameters)),
            "nats": float(log_likelihoods(game, policies[-1], self._problem.held_out).mean()),
            "occupancy_distance": game.judge.distance([policies[-1], self._experts], 0),
        }

    def _constraints(self, experiment: Experiment, name: str, parameters: Parameters, shown: Trajectories) -> Row:
        learned, confidences, _, _ = learned_constraints(
            experiment, name, parameters, self._problem.streams, self._game
        )
        threshold = by_threshold(parameters.omega, experiment.constraint_threshold)
        of_paper = constraint_errors(threshold, known_constraints(self._game))
        errors = self._errors(learned, -parameters.omega if confidences is None else confidences, shown)
        return {**errors, "threshold_fdr": of_paper.false_discovery_rate, "threshold_fpr": of_paper.false_positive_rate}

    def _errors(self, learned: Mask, scores: Vector, shown: Trajectories) -> Row:
        truth = known_constraints(self._game)
        used = shown_features(self._game, shown).used
        decidable = decidable_constraints(self._touch, truth, len(shown.states))
        return {
            "called": int(learned.sum()),
            "false": int((learned & ~truth).sum()),
            "called_used": int((learned & used).sum()),
            "decidable": int(decidable.sum()),
            "found": int((learned & decidable).sum()),
            "auc": ranking_auc(scores, truth),
            "called_at": [int((scores >= level).sum()) for level in LEVELS],
            "false_at": [int((~truth & (scores >= level)).sum()) for level in LEVELS],
            "found_at": [int((decidable & (scores >= level)).sum()) for level in LEVELS],
        }
