"""What a step rule is: how long the step down the gradient of iteration n is, coordinate by coordinate.

A rule may remember what it has seen; its memory is arrays by name, which checkpoints hold and learners do not exchange.
"""

from collections.abc import Mapping
from typing import Protocol

from mabirds_core.algorithm.gradient import GradientEstimate
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array

RuleState = Mapping[str, Array]
"""What a rule remembers, by name."""


class StepRule(Protocol):
    """How far a learner goes."""

    def initial(self, parameters: Parameters) -> RuleState:
        """What is remembered before the first step, for theta and omega of these shapes."""
        ...

    def step(self, state: RuleState, estimate: GradientEstimate, n: int) -> tuple[Parameters, RuleState]:
        """One step.

        Parameters
        ----------
        state : RuleState
            What is remembered.
        estimate : GradientEstimate
            Expected and demonstrated counts at theta(n), omega(n).
        n : int
            Number of the step, from 1.

        Returns
        -------
        tuple[Parameters, RuleState]
            What is taken off theta and omega, and what is remembered after it.
        """
        ...


class RevealingRule(Protocol):
    """A rule whose steps tell what was demonstrated, as an audit of privacy shows."""

    def reveal(
        self, state: RuleState, step: Parameters, estimate: GradientEstimate, n: int
    ) -> tuple[Parameters, RuleState]:
        """What somebody learns who sees a step: the inverse of ``StepRule.step``.

        Parameters
        ----------
        state : RuleState
            What the rule remembered before the step.
        step : Parameters
            What was taken off theta and omega.
        estimate : GradientEstimate
            At theta(n), omega(n); what it says was demonstrated is not looked at.
        n : int
            Number of the step, from 1.

        Returns
        -------
        tuple[Parameters, RuleState]
            Means of grad J and mu over the demonstrations, NaN where they cannot be told, and what the rule remembers.
        """
        ...
