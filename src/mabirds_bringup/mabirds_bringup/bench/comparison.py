"""What was learned beside what there was to learn: experts, held-out demonstrations, optimum, decidable constraints."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mabirds_bringup.bench.gradient import gradient_norm
from mabirds_bringup.evaluate.constraints import learned_constraints
from mabirds_bringup.evaluate.evaluation import distance_to_experts
from mabirds_bringup.evaluate.held_out import HeldOut, draw_held_out
from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Mask, Vector
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Streams
from mabirds_core.games.judging import ImitationMetrics
from mabirds_core.games.tabular.decidable import touch_without
from mabirds_core.games.truth import known_constraints
from mabirds_core.games.whole_game import Game
from mabirds_core.metrics.constraints import constraint_errors
from mabirds_core.metrics.curves import LATE
from mabirds_core.planners.interface import Policy

DECIDABLE_AT = 0.99
"""A constraint is decidable where experts without it would have been seen to touch it with this probability."""

JUDGED = ("success", "violation", "value", "certificate")
"""What planners that took no part say."""

EARLY = 20
"""Iterations after which no policy should fail any more."""

SETTLED = 40
"""Iterations after which none should, where demonstrations are many."""

LAST = 10
"""Iterations whose mean should be what the last one is."""


@dataclass(frozen=True)
class Comparison:
    """Of one experiment, for all who learned from its streams.

    Attributes
    ----------
    experiment, game, streams
        What was learned, and from what.
    held_out : HeldOut
        Experts and demonstrations of theirs.
    best : float or None
        Held-out log likelihood of the pooled optimum, or of an iterate on the way to it, whatever is better [nats].
    touch : Vector or None
        Probability that experts who are free of a constraint touch it, shape (K,).
    """

    experiment: Experiment
    game: Game
    streams: Streams
    held_out: HeldOut
    best: float | None = None
    touch: Vector | None = None

    @classmethod
    def of(cls, experiment: Experiment, game: Game, streams: Streams, *, optimum: bool) -> "Comparison":
        """Draw the held-out demonstrations; ``optimum``: find the pooled optimum, and what can be decided.

        Raises
        ------
        ExperimentError
            The optimum is asked for of a game that cannot be enumerated.
        """
        held_out = draw_held_out(experiment, game)
        if not optimum:
            return cls(experiment, game, streams, held_out)
        if not hasattr(game, "successor") or held_out.demonstrations is None:
            raise ExperimentError(f"optimum: game {experiment.game.kind}: expected one that can be enumerated")
        from mabirds_bringup.bench.pooled import pooled_optimum  # scipy would count as memory of what was learned

        tabular: Any = game
        pooled = stacked([demonstration for stream in streams.values() for demonstration in stream])
        found = pooled_optimum(tabular, pooled, held_out.demonstrations)
        return cls(experiment, game, streams, held_out, max(found.final, found.best), touch_without(tabular))

    def measures(
        self, name: str, parameters: Parameters, policy: Policy, rates: Mapping[int, ImitationMetrics]
    ) -> dict[str, float]:
        """Of a learner or method; what cannot be said is left out.

        Parameters
        ----------
        name : str
            Of the learner or method.
        parameters : Parameters
            theta and omega in the end.
        policy : Policy
            Which they mean.
        rates : Mapping[int, ImitationMetrics]
            By iteration that was judged, in order; 0 is theta(1).

        Returns
        -------
        dict[str, float]
            ``late_success``, the least SR of the last iterations; ``success_after_20`` and ``success_after_40``, that
            after EARLY and SETTLED iterations; ``last_ten_change``, by how much the mean SR of the LAST differs from
            the last; ``expert_nats`` per demonstration, ``nats_below_optimum``, and of fixed policies ``fixed_nats``,
            their best; ``occupancy_distance`` to the experts; ``gradient_norm`` on the demonstrations of all,
            where it is found by rollouts; of the game's test of constraints ``called``, ``tested_fdr``, ``auc`` and
            ``decidable_found``.
        """
        success, last = {n: rate.success_rate for n, rate in rates.items()}, max(rates)
        nats = self.held_out.log_likelihood(self.game, policy)
        late = [rate for n, rate in success.items() if n > last - LAST]
        found = {
            "late_success": min(rate for n, rate in success.items() if n > last - LATE),
            "success_after_20": min((rate for n, rate in success.items() if n > EARLY), default=None),
            "success_after_40": min((rate for n, rate in success.items() if n > SETTLED), default=None),
            "last_ten_change": abs(sum(late) / len(late) - success[last]),
            "fixed_nats": max(self.held_out.fixed_log_likelihoods(self.game, policy).values(), default=None),
            "expert_nats": self.held_out.log_likelihood(self.game, self.held_out.experts),
            "nats_below_optimum": None if nats is None or self.best is None else self.best - nats,
            "gradient_norm": gradient_norm(self.experiment, name, parameters, policy, self.streams),
            "occupancy_distance": distance_to_experts(self.experiment, self.game, policy, self.held_out),
            **self._constraints(name, parameters),
        }
        return {measure: float(value) for measure, value in found.items() if value is not None}

    def _constraints(self, name: str, parameters: Parameters) -> dict[str, float | None]:
        """By the game's test; nothing where it has none."""
        constraints = learned_constraints(self.experiment, name, parameters, self.streams, self.game)
        if constraints.confidences is None:
            return {}
        return {
            "called": float(constraints.learned.sum()),
            "tested_fdr": constraint_errors(constraints.learned, known_constraints(self.game)).false_discovery_rate,
            "auc": constraints.auc,
            "decidable_found": self._found(constraints.learned),
        }

    def _found(self, learned: Mask) -> float | None:
        """Share of the constraints that one learner's demonstrations can decide; None where there are none."""
        if self.touch is None:
            return None
        decidable = decidable_constraints(self.touch, known_constraints(self.game), self.experiment.iterations)
        return float(learned[decidable].mean()) if decidable.any() else None


def decidable_constraints(touch: Vector, true_constraints: Mask, demonstrations: int) -> Mask:
    """Which constraints N demonstrations can decide.

    Parameters
    ----------
    touch : Vector
        Probability that experts who are free of a constraint touch it, shape (K,).
    true_constraints : Mask
        Shape (K,).
    demonstrations : int
        N.

    Returns
    -------
    Mask
        Those that experts free of them would have touched, with probability DECIDABLE_AT.
    """
    return np.asarray(true_constraints & (1 - (1 - touch) ** demonstrations >= DECIDABLE_AT))
