"""``mabirds simulate``: the same experiment in one process, the reference for the network."""

import time
from collections.abc import Sequence
from pathlib import Path

from mabirds_bringup.commands.options import CentralMethodName, ExperimentFile, Json, RunsDirectory
from mabirds_bringup.console import guarded_output, print_json, progress_bar
from mabirds_bringup.evaluate.results import write_results
from mabirds_bringup.run import run_directory
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import History, Streams, simulate_central
from mabirds_core.experiment.simulate import simulate as simulate_network
from mabirds_msgs_py.bag_reader import DemonstrationBag


def simulate(
    file: ExperimentFile,
    method: CentralMethodName = None,
    out: RunsDirectory = Path("runs"),
    as_json: Json = False,
) -> None:
    """Run an experiment's learners in one process, without any network; same results to the last bit.

    Example: mabirds simulate ros_ws/config/patrol.yaml
    """
    with guarded_output() as stdout:
        experiment = load_experiment(file)
        start = time.monotonic()
        demonstrations = demonstrations_of(experiment)
        history = simulate_with_progress(experiment, demonstrations, method)
        directory = run_directory.create(out, experiment.name)
        run_directory.write_manifest(directory, experiment, file, "in process")
        content = write_results(experiment, history, demonstrations, directory, time.monotonic() - start)
        if as_json:
            print_json(content, stdout)


def demonstrations_of(experiment: Experiment, bags: Sequence[Path] = ()) -> Streams:
    """Each learner's demonstrations, from these bags or the experiment's own."""
    with DemonstrationBag(bags or experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        return {name: list(bag.trajectories(name)) for name in experiment.learners}


def simulate_from_bag(experiment: Experiment, method: str | None = None) -> History:
    """The in-process network, or a central method, on the experiment's own bag, with a bar of progress."""
    return simulate_with_progress(experiment, demonstrations_of(experiment), method)


def simulate_with_progress(experiment: Experiment, demonstrations: Streams, method: str | None) -> History:
    """The in-process network, or a central method, with a bar of progress."""
    with progress_bar() as bar:
        task = bar.add_task("learning", total=experiment.iterations * (1 if method else len(experiment.learners)))
        if method:
            return simulate_central(experiment, method, demonstrations, lambda _: bar.advance(task))
        return simulate_network(experiment, demonstrations, lambda _: bar.advance(task))
