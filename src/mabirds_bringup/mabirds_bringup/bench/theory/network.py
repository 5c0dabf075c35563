"""The network of ``simulate`` with each learner's gradient by iteration, and remedies for problems without optimum.

Where constraints are hard, no finite omega solves the inner problem. Two remedies give it an optimum:

    bounded        omega is clipped to [-OMEGA_BOUND, OMEGA_BOUND] after each step (projected descent)
    regularised    the dual is G(omega) + WEIGHT / 2 |omega|^2; its gradient is E_pi mu - b + WEIGHT omega
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mabirds_bringup.bench.theory.cases import LEARNERS
from mabirds_bringup.bench.theory.problem import Problem
from mabirds_core.algorithm.gradient import GradientEstimate, GradientEstimator
from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.memory import Memory
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.consensus.mixer import LocalStep
from mabirds_core.consensus.strict import StrictMixer, StrictState
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.planners.interface import Policy

OMEGA_BOUND, WEIGHT = 3.0, 0.01


class Iterate(NamedTuple):
    """Iteration n of one learner: theta(n), omega(n), and the gradient there."""

    parameters: Parameters
    estimate: GradientEstimate


@dataclass(frozen=True)
class BoundedMixer(StrictMixer):
    """Strict mixing; omega is clipped after the local step."""

    def mix(self, state: StrictState, iteration: int, local_step: LocalStep | None) -> StrictState:
        """The weighted sum, the step, and the nearest point of the box."""
        theta, omega = super().mix(state, iteration, local_step).parameters
        return StrictState(Parameters(theta, np.clip(omega, -OMEGA_BOUND, OMEGA_BOUND)))


@dataclass(frozen=True)
class RegularisedEstimator(GradientEstimator):
    """The gradient of G + WEIGHT / 2 |omega|^2."""

    def __call__(
        self, parameters: Parameters, memory: Memory, rng: np.random.Generator, previous: Policy | None = None
    ) -> GradientEstimate:
        """With WEIGHT omega taken off what was observed, so that what is expected stays the policy's."""
        estimate = super().__call__(parameters, memory, rng, previous)
        omega = estimate.observed.omega - WEIGHT * parameters.omega
        return estimate._replace(observed=estimate.observed._replace(omega=omega))


def learners(problem: Problem) -> dict[str, Learner]:
    """Those of the experiment, with the case's remedy."""
    built = {name: build_learner(problem.experiment, name, problem.game) for name in LEARNERS}
    return {name: _remedied(learner, problem.case.omega) for name, learner in built.items()}


def _remedied(learner: Learner, remedy: str) -> Learner:
    if remedy == "regularised":
        of = learner.estimator
        estimator = RegularisedEstimator(of.game, of.reward, of.planner, of.expectation, of.rollout_start)
        return replace(learner, estimator=estimator)
    if remedy == "bounded":
        mixer = learner.mixer
        if not isinstance(mixer, StrictMixer):
            raise ExperimentError(f"mixing {type(mixer).__name__}: expected strict mixing where omega is bounded")
        return replace(learner, mixer=BoundedMixer(mixer.name, mixer.schedule))
    return learner


def iterates(problem: Problem) -> Iterator[list[Iterate]]:
    """Iterations 1, 2, ... of all learners, in the order of ``simulate``, from the same ``Learner.step``."""
    network, streams = learners(problem), problem.streams()
    states = {name: learner.initial_state() for name, learner in network.items()}
    for n in range(1, problem.iterations + 1):
        sent = {name: network[name].mixer.outgoing(state.mixing, n) for name, state in states.items()}
        results = {
            name: learner.step(states[name], streams[name][n - 1], _to(name, sent)) for name, learner in network.items()
        }
        yield [Iterate(states[name].parameters, result.estimate) for name, result in results.items()]
        states = {name: result.state for name, result in results.items()}


def _to(name: str, sent: Mapping[str, Mapping[str, Parameters]]) -> dict[str, Parameters]:
    return {sender: of_sender[name] for sender, of_sender in sent.items() if name in of_sender}
