"""What the updates of a network cost without any exchange: the part of a learner's time that is no message's."""

from itertools import pairwise
from pathlib import Path
from statistics import median
from time import process_time

from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_msgs_py.bag_reader import DemonstrationBag


def learning_milliseconds(file: Path) -> float:
    """Processor time of a learner's update in one loop.

    Parameters
    ----------
    file : Path
        Of the experiment, whose bag is there.

    Returns
    -------
    float
        Milliseconds, the median.
    """
    experiment, times = load_experiment(file), list[float]()
    with DemonstrationBag(experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        streams = {name: list(bag.trajectories(name)) for name in experiment.learners}
    simulate(experiment, streams, lambda _: times.append(process_time()))
    return 1e3 * median(after - before for before, after in pairwise(times))
