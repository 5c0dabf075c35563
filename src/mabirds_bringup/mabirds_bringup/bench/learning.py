"""Learning a case, and its demonstrations."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from itertools import islice

from mabirds_bringup.bench.cases import Case
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Progress, simulate, simulate_central
from mabirds_core.games.interface import Game, Trajectories
from mabirds_expert_player.recorder import expert_streams

Streams = Mapping[str, Sequence[Trajectories]]


def drawn_streams(experiment: Experiment, game: Game) -> dict[str, list[Trajectories]]:
    """As many demonstrations for each learner as it learns from, drawn in memory."""
    return {
        learner: list(islice(stream, experiment.iterations))
        for learner, stream in expert_streams(experiment, game).items()
    }


def learn(
    case: Case, experiment: Experiment, streams: Streams, on_update: Callable[[Progress], None] = lambda _: None
) -> tuple[History, dict[str, list[Progress]]]:
    """History, and progress without policies, which fill the memory: ``on_update`` may look at them."""
    progress = defaultdict[str, list[Progress]](list)

    def keep(update: Progress) -> None:
        on_update(update)
        progress[update.name].append(update._replace(policy=None))

    if case.method:
        return simulate_central(experiment, case.method, streams, keep), progress
    return simulate(experiment, streams, keep), progress
