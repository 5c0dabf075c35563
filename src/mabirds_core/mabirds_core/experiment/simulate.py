"""The in-process network: N_L learners in one loop. The reference that the ROS network must equal bit for bit.

Central methods run in the same way, on the demonstrations of all learners.
"""

from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import NamedTuple

from mabirds_core.algorithm.gradient import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.baselines.interface import Work
from mabirds_core.consensus.settings import ResilientMixing
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, build_learner, build_method, build_resilient_learner
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories
from mabirds_core.planners.interface import Policy

History = dict[str, list[Parameters]]
"""theta(n), omega(n) by the name of the learner or method; entry k is iteration n = k + 1."""

Streams = Mapping[str, Sequence[Trajectories]]
"""Each learner's demonstrations by its name."""


class Progress(NamedTuple):
    """One update of one learner or method: how long it took, all work since the beginning, the policy it found."""

    name: str
    seconds: float
    work: Work
    policy: Policy = None


OnUpdate = Callable[[Progress], None]


def simulate(experiment: Experiment, demonstrations: Streams, on_update: OnUpdate = lambda _: None) -> History:
    """Run every learner for ``experiment.iterations`` updates, ``on_update`` is called after each, and closing rounds.

    In resilient mode as if nothing were lost. Raises ExperimentError for a stream that is too short.
    """
    if isinstance(experiment.mixing, ResilientMixing):
        return simulate_resilient(experiment, demonstrations, on_update=on_update)
    _require_streams(experiment, demonstrations)
    game = build_game(experiment)
    learners = {name: build_learner(experiment, name, game) for name in experiment.learners}
    states = {name: learner.initial_state() for name, learner in learners.items()}
    history: History = {name: [state.parameters] for name, state in states.items()}
    for iteration in range(1, experiment.iterations + experiment.closing_rounds + 1):
        known = {learner.index: states[name].parameters for name, learner in learners.items()}
        for name, learner in learners.items():
            neighbours = {u: known[u] for u in learner.schedule.in_neighbours(learner.index, iteration)}
            if iteration > experiment.iterations:
                states[name] = learner.agree(states[name], neighbours)
            else:
                start = perf_counter()
                states[name] = learner.update(states[name], demonstrations[name][iteration - 1], neighbours).state
                seconds = perf_counter() - start
                on_update(Progress(name, seconds, Work(iteration, iteration), states[name].policy))
            history[name].append(states[name].parameters)
    return history


Delivers = Callable[[int, str, str], bool]
"""Does the message of iteration n from a sender to a receiver arrive? In that iteration; what is lost comes later."""


def simulate_resilient(
    experiment: Experiment,
    demonstrations: Streams,
    delivers: Delivers = lambda *_: True,
    on_update: OnUpdate = lambda _: None,
) -> History:
    """The same in resilient mode, on a network that loses what ``delivers`` says it loses."""
    _require_streams(experiment, demonstrations)
    game = build_game(experiment)
    learners = {name: build_resilient_learner(experiment, name, game) for name in experiment.learners}
    states = {name: one.begin(one.learner.initial_state()) for name, one in learners.items()}
    history: History = {name: [state.learner.parameters] for name, state in states.items()}
    for iteration in range(1, experiment.iterations + experiment.closing_rounds + 1):
        sent = {name: state.ledger.given for name, state in states.items()}
        for name, one in learners.items():
            scheduled = (experiment.learners[u] for u in one.schedule.in_neighbours(one.learner.index, iteration))
            sums = {u: sent[u][name] for u in scheduled if name in sent[u] and delivers(iteration, u, name)}
            if iteration > experiment.iterations:
                states[name] = one.agree(states[name], sums)
            else:
                start = perf_counter()
                states[name] = one.update(states[name], demonstrations[name][iteration - 1], sums).state
                on_update(Progress(name, perf_counter() - start, Work(iteration, iteration)))
            history[name].append(states[name].learner.parameters)
    return history


def simulate_central(
    experiment: Experiment, name: str, demonstrations: Streams, on_update: OnUpdate = lambda _: None
) -> History:
    """Run central method ``name`` on all streams; otherwise as ``simulate``."""
    _require_streams(experiment, demonstrations)
    method = build_method(experiment, name)
    state = method.initial_state()
    history: History = {name: [state.parameters]}
    for iteration in range(1, experiment.iterations + 1):
        pooled = stacked([demonstrations[learner][iteration - 1] for learner in experiment.learners])
        start = perf_counter()
        state = method.update(state, pooled)
        history[name].append(state.parameters)
        on_update(Progress(name, perf_counter() - start, state.work, state.policy))
    return history


def _require_streams(experiment: Experiment, demonstrations: Streams) -> None:
    for name in experiment.learners:
        if (count := len(demonstrations.get(name, ()))) < experiment.iterations:
            raise ExperimentError(
                f"{name} has {count} demonstrations, expected {experiment.iterations}; record more, or lower iterations"
            )
