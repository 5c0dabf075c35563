"""``mabirds simulate``: the same experiment in one process, the reference for the network."""

import time
from pathlib import Path

from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.options import CentralMethodName, Evaluation, ExperimentFile, Json, RunsDirectory
from mabirds_bringup.console import ending_as_interrupted, guarded_output, print_json, progress_bar
from mabirds_bringup.evaluate.results import write_results, write_unevaluated
from mabirds_bringup.run.certificate import certify
from mabirds_bringup.run.size import shown_size
from mabirds_bringup.run.stored_run import begin
from mabirds_core.digest import demonstrations_digest
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import History, Streams, simulate_central
from mabirds_core.experiment.simulate import simulate as simulate_network


def simulate(
    file: ExperimentFile,
    method: CentralMethodName = None,
    out: RunsDirectory = Path("runs"),
    evaluation: Evaluation = True,
    as_json: Json = False,
) -> None:
    """Run an experiment's learners in one process, without any network; same results to the last bit.

    Example: mabirds simulate ros_ws/config/patrol.yaml
    """
    with guarded_output() as stdout, ending_as_interrupted():
        experiment = load_experiment(file)
        shown_size(experiment, 1)
        start = time.monotonic()
        demonstrations = demonstrations_of(experiment)
        shown = {name: stream[: experiment.iterations] for name, stream in demonstrations.items()}
        digest = demonstrations_digest(shown)
        history = simulate_with_progress(experiment, demonstrations, method)
        stored = begin(out, experiment, file, bag_digest=digest, plan=None, method=method)
        with stored.open_history() as kept:
            kept.take(history)
            certificate = certify(stored, kept)
        seconds = time.monotonic() - start
        if evaluation:
            content = write_results(experiment, history, demonstrations, stored.directory, seconds, certificate)
        else:
            content = write_unevaluated(stored.directory, certificate, seconds)
        if as_json:
            print_json(content, stdout)


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
