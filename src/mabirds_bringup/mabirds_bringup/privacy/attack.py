"""The demonstrations of a learner from what it published, by somebody who has the experiment file.

    mixed = sum_u W(n)[v, u] theta_u(n),     step = mixed - theta(n + 1)

The step rule, undone, tells what was demonstrated until n on average; less what was demonstrated until n - 1 it is
zeta(n) in discounted counts of the cost features, and these are the steps of one trajectory only. The expected counts
that a rule compares with are anybody's to compute, from theta(n), omega(n) and public seeds. Where experts begin at
several places, a learner that already expects what it is shown takes no step, and so does not tell where it began.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from mabirds_bringup.privacy.decoding import Decoder
from mabirds_core.algorithm.gradient import GradientEstimate
from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.steps import RevealingRule
from mabirds_core.arrays import Indices, Vector
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History
from mabirds_core.games.interface import TabularGame, Trajectories, discounted_visitation
from mabirds_core.planners.interface import Policy

Rebuilt = Sequence[Indices | None]
"""Joint states t = 0..T of each demonstration; None where it could not be told."""


def rebuild(experiment: Experiment, name: str, history: History) -> Rebuilt:
    """Rebuild the demonstrations of ``name`` from theta and omega of all learners.

    Raises ExperimentError where this attack is none: for other games, mixing or step rules.
    """
    learner = build_learner(experiment, name)
    if not learner.estimator.costs.linear:
        raise ExperimentError("algorithm.cost: this audit is of linear costs, whose steps tell counts")
    if experiment.mixing.declares_members:
        raise ExperimentError("mixing is resilient: this audit is of strict mixing, where neighbours see theta, omega")
    transitions = getattr(learner.game, "transitions", None)
    if transitions is None or not transitions.deterministic or not hasattr(learner.steps, "reveal"):
        raise ExperimentError(
            "this audit is of games with a table of transitions, and of step rules that can be undone"
        )
    return list(_Attack(experiment, learner, history).demonstrations())


class _Known:
    """What is known of the demonstrations until now: their counts and starts."""

    def __init__(self, length: int | None) -> None:
        self._length, self.counts, self.starts = length, list[Vector](), list[int]()

    def newest(self, observed: Vector) -> Vector:
        """The counts of the newest demonstration, from the mean of those that are remembered."""
        before = self.counts if self._length is None else self.counts[max(0, len(self.counts) + 1 - self._length) :]
        return (len(before) + 1) * observed - np.sum([np.zeros_like(observed), *before], axis=0)

    def begun(self, start: int) -> Indices:
        """Starts of those that are remembered, with that of the newest."""
        starts = [*self.starts, start]
        return np.array(starts if self._length is None else starts[-self._length :])


@dataclass(frozen=True)
class _Attack:
    experiment: Experiment
    learner: Learner
    history: History

    @property
    def _game(self) -> TabularGame:
        return cast("TabularGame", self.learner.game)

    def demonstrations(self) -> Iterator[Indices | None]:
        """One after the other; counts of one that could not be told are those that were computed."""
        window = self.experiment.algorithm.window
        known, decoder = _Known(None if window == "all" else window), Decoder(self._game)
        rule, policy = self.learner.steps.initial(self._at(self.learner.mixer.name, 1)), None
        for n in range(1, self.experiment.iterations + 1):
            attempts = []
            for start in np.flatnonzero(self._game.initial_distribution):
                estimate = self._expected(n, known.begun(int(start)), policy)
                observed, remembered = self._rule.reveal(rule, self._step(n), estimate, n)
                counts = known.newest(observed.omega)
                states = decoder.steps(counts, int(start))
                attempts.append((states, counts, int(start), remembered, estimate.policy))
                if states is not None:
                    break
            states, counts, begun, rule, policy = attempts[-1]
            known.counts.append(counts if states is None else self._counts_of(states))
            known.starts.append(begun)
            yield states

    @property
    def _rule(self) -> RevealingRule:
        return cast("RevealingRule", self.learner.steps)

    def _at(self, name: str, n: int) -> Parameters:
        return self.history[name][n - 1]

    def _step(self, n: int) -> Parameters:
        """What was taken off the mixed theta(n), omega(n)."""
        mixer, name = cast("Any", self.learner.mixer), self.learner.mixer.name
        senders: Mapping[str, Parameters] = {u: self._at(u, n) for u in mixer.schedule.senders_to(name, n)}
        mixed = mixer.mix(mixer.incoming(mixer.initial(self._at(name, n)), n, senders), n, None).parameters
        after = self._at(name, n + 1)
        return Parameters(mixed.theta - after.theta, mixed.omega - after.omega)

    def _expected(self, n: int, starts: Indices, policy: Policy | None) -> GradientEstimate:
        """What the learner expected at iteration n; the other side of the estimate is not looked at."""
        parameters = self._at(self.learner.mixer.name, n)
        memory = _Pretended(starts, self._fill(n))
        rng = np.random.default_rng([self.learner.seed, self.learner.index, n])
        return self.learner.estimator(parameters, cast("Any", memory), rng, policy)

    def _fill(self, n: int) -> float:
        window = self.experiment.algorithm.window
        return 1.0 if window == "all" else min(n, window) / window

    def _counts_of(self, states: Indices) -> Vector:
        """Of the trajectory with these states: its actions are those that lead on, whichever of equals."""
        successor = self._game.successor
        onward = [int(np.flatnonzero(successor[s] == after)[0]) for s, after in itertools.pairwise(states)]
        actions = np.array([*onward, onward[-1] if onward else 0])
        visitation = discounted_visitation(Trajectories(states[None], actions[None]), self._game.discount)
        return self._game.cost_features.total(visitation)


@dataclass(frozen=True)
class _Pretended:
    """A memory of starts alone, which is all that an expectation needs of it."""

    starts: Indices
    fill: float
    examples: None = None

    def observed(self, parameters: Parameters) -> Parameters:
        """Not known, and not looked at."""
        return Parameters(*(np.full_like(values, np.nan) for values in parameters))
