"""The in-process network: N_L learners in one loop. The reference that the ROS network must equal bit for bit."""

from collections.abc import Callable, Mapping, Sequence

from mabirds_core.algorithm import Parameters
from mabirds_core.assembly import build_game, build_learner
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment import Experiment
from mabirds_core.games.interface import Trajectories

History = dict[str, list[Parameters]]
"""theta(n), omega(n) by learner's name; entry k is iteration n = k + 1."""


def simulate(
    experiment: Experiment,
    demonstrations: Mapping[str, Sequence[Trajectories]],
    on_iteration: Callable[[int], None] = lambda _: None,
) -> History:
    """Run every learner for ``experiment.iterations`` updates; ``on_iteration(n)`` is called after each.

    ``demonstrations`` maps each learner's name to its own stream. Raises ExperimentError for a stream that is
    too short.
    """
    game = build_game(experiment)
    learners = {name: build_learner(experiment, name, game) for name in experiment.learners}
    for name in learners:
        if (count := len(demonstrations.get(name, ()))) < experiment.iterations:
            raise ExperimentError(
                f"{name} has {count} demonstrations, expected {experiment.iterations}; record more, or lower iterations"
            )
    states = {name: learner.initial_state() for name, learner in learners.items()}
    history: History = {name: [state.parameters] for name, state in states.items()}
    for iteration in range(1, experiment.iterations + 1):
        known = {learner.index: states[name].parameters for name, learner in learners.items()}
        for name, learner in learners.items():
            neighbours = {u: known[u] for u in learner.schedule.in_neighbours(learner.index, iteration)}
            states[name] = learner.update(states[name], demonstrations[name][iteration - 1], neighbours).state
            history[name].append(states[name].parameters)
        on_iteration(iteration)
    return history
