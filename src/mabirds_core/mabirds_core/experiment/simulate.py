"""The in-process network: N_L learners in one loop. The reference that the ROS network must equal bit for bit.

Central methods run in the same loop, one on the demonstrations of all learners.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple, Protocol

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.baselines.interface import CentralMethod, CentralState, Cost
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, build_learner, build_method
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories
from mabirds_core.planners.interface import Policy

History = dict[str, list[Parameters]]
"""theta(n), omega(n) by the name of the learner or method; entry k is iteration n = k + 1."""

Streams = Mapping[str, Sequence[Trajectories]]
"""Each learner's demonstrations by its name."""


class Progress(NamedTuple):
    """One update of one learner or method.

    Attributes
    ----------
    name : str
        Of the learner or method.
    seconds : float
        How long it took.
    work : Cost
        All since the beginning.
    policy : Policy
        The one it found.
    """

    name: str
    seconds: float
    work: Cost
    policy: Policy = None


OnUpdate = Callable[[Progress], None]


Delivers = Callable[[int, str, str], bool]
"""Does the message of iteration n from a sender to a receiver arrive? In that iteration; what is lost comes later."""


def simulate(
    experiment: Experiment,
    demonstrations: Streams,
    on_update: OnUpdate = lambda _: None,
    delivers: Delivers = lambda *_: True,
) -> History:
    """Run every learner for ``experiment.iterations`` updates, and closing rounds.

    Parameters
    ----------
    experiment : Experiment
        With learners, schedule and algorithm.
    demonstrations : Streams
        One per learner and update, or more.
    on_update : OnUpdate, optional
        Is called after each update.
    delivers : Delivers, optional
        A network that loses messages, which resilient mixing survives.

    Returns
    -------
    History
        theta and omega of every learner.

    Raises
    ------
    ExperimentError
        A stream is too short.
    ScheduleError
        A message to a strict mixer is lost, for which it would wait for ever.
    """
    _require_streams(experiment, demonstrations)
    game = build_game(experiment)
    learners = {name: build_learner(experiment, name, game) for name in experiment.learners}
    return simulate_learners(
        learners, demonstrations, experiment.iterations, experiment.closing_rounds, on_update, delivers
    )


def simulate_learners(
    learners: Mapping[str, Learner],
    demonstrations: Streams,
    iterations: int,
    closing_rounds: int,
    on_update: OnUpdate = lambda _: None,
    delivers: Delivers = lambda *_: True,
) -> History:
    """Run learners that are built already, of any game.

    Parameters
    ----------
    learners : Mapping[str, Learner]
        By name.
    demonstrations : Streams
        One per learner and update, or more.
    iterations : int
        N: updates.
    closing_rounds : int
        Of mixing alone.
    on_update : OnUpdate, optional
        Is called after each update.
    delivers : Delivers, optional
        A network that loses messages, which resilient mixing survives.

    Returns
    -------
    History
        theta and omega of every learner.
    """
    parts: dict[str, _Part] = {
        name: _LearnerPart(learner, demonstrations[name], iterations, learner.initial_state())
        for name, learner in learners.items()
    }
    return _run(parts, iterations + closing_rounds, on_update, delivers)


def simulate_central(
    experiment: Experiment, name: str, demonstrations: Streams, on_update: OnUpdate = lambda _: None
) -> History:
    """Run a central method on all streams, without closing rounds.

    Parameters
    ----------
    experiment : Experiment
        With the settings of the method.
    name : str
        Of the method.
    demonstrations : Streams
        One per learner and update, or more.
    on_update : OnUpdate, optional
        Is called after each update.

    Returns
    -------
    History
        theta and omega of the method.

    Raises
    ------
    ExperimentError
        A stream is too short, or there is no such method for the game.
    """
    _require_streams(experiment, demonstrations)
    method = build_method(experiment, name)
    streams = [demonstrations[learner] for learner in experiment.learners]
    return _run({name: _CentralPart(method, streams, method.initial_state())}, experiment.iterations, on_update)


class _Part(Protocol):
    """Who takes part in the loop: its state, its demonstrations, and how to go on."""

    @property
    def state(self) -> LearnerState | CentralState:
        """The state before update n."""
        ...

    @property
    def policy(self) -> Policy:
        """That of the newest update."""
        ...

    def outgoing(self) -> Mapping[str, Any]:
        """What it sends at iteration n, by receiver."""
        ...

    def advance(self, incoming: Mapping[str, Any]) -> Cost | None:
        """Make update n; all work since the beginning, or None where there was none but mixing."""
        ...


@dataclass
class _LearnerPart:
    learner: Learner
    stream: Sequence[Trajectories]
    iterations: int
    state: LearnerState
    policy: Policy = None

    def outgoing(self) -> Mapping[str, Any]:
        return self.learner.mixer.outgoing(self.state.mixing, self.state.iteration)

    def advance(self, incoming: Mapping[str, Any]) -> Cost | None:
        n = self.state.iteration
        if n > self.iterations:
            self.state = self.learner.consensus_step(self.state, incoming)
            return None
        self.policy = None  # before the next one is found
        self.state, estimate = self.learner.step(self.state, self.stream[n - 1], incoming)
        self.policy = estimate.policy
        return Cost(n, n)


@dataclass
class _CentralPart:
    method: CentralMethod
    streams: Sequence[Sequence[Trajectories]]
    state: CentralState

    @property
    def policy(self) -> Policy:
        return self.state.policy

    def outgoing(self) -> Mapping[str, Any]:
        return {}

    def advance(self, incoming: Mapping[str, Any]) -> Cost | None:  # noqa: ARG002 - nobody sends it anything
        pooled = stacked([stream[self.state.iteration - 1] for stream in self.streams])
        self.state = self.method.update(self.state, pooled)
        return self.state.work


def _run(
    parts: Mapping[str, _Part], iterations: int, on_update: OnUpdate, delivers: Delivers = lambda *_: True
) -> History:
    """All send, then one after the other receives and goes on; an order of parts that changes no result."""
    history: History = {name: [part.state.parameters] for name, part in parts.items()}
    for n in range(1, iterations + 1):
        sent = {name: part.outgoing() for name, part in parts.items()}
        for name, part in parts.items():
            incoming = {u: of_u[name] for u, of_u in sent.items() if name in of_u and delivers(n, u, name)}
            start = perf_counter()
            work = part.advance(incoming)
            seconds = perf_counter() - start
            history[name].append(part.state.parameters)
            if work is not None:
                on_update(Progress(name, seconds, work, part.policy))
    return history


def _require_streams(experiment: Experiment, demonstrations: Streams) -> None:
    for name in experiment.learners:
        if (count := len(demonstrations.get(name, ()))) < experiment.iterations:
            raise ExperimentError(
                f"{name} has {count} demonstrations, expected {experiment.iterations}; record more, or lower iterations"
            )
