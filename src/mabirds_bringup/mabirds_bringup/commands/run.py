"""``mabirds run``: the experiment as a network of processes."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import typer
from rich.live import Live

from mabirds_bringup.commands.options import CentralMethodName, ExperimentFile, Json, RunsDirectory
from mabirds_bringup.commands.player_options import LESS_THAN_ALL, takes_player_options
from mabirds_bringup.commands.simulate import demonstrations_of
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_bringup.evaluate.results import audit, write_results
from mabirds_bringup.run import run_directory
from mabirds_bringup.run.network import Network
from mabirds_bringup.run.supervisor import Supervisor
from mabirds_bringup.watch.live_table import live_table, plain_line
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import Streams

LINE_PERIOD = 2.0
"""Seconds between two lines of progress where the output is not a terminal."""


@takes_player_options(*LESS_THAN_ALL)
def run(  # noqa: PLR0913, PLR0917 - the options of a command
    file: ExperimentFile,
    player: dict[str, Any],
    method: CentralMethodName = None,
    restarts: Annotated[
        int, typer.Option(help="How often a node that died is started again; it goes on where it was.", min=0)
    ] = 3,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Start only this learner, or expert_player, on this host; may be given several times."),
    ] = None,
    name: Annotated[str, typer.Option("--run", help="With --only: a name that all hosts of the run share.")] = "",
    out: RunsDirectory = Path("runs"),
    as_json: Json = False,
) -> None:
    """Run an experiment: one process per learner plus the expert player, until everything is learned.

    Example: mabirds run ros_ws/config/patrol.yaml --rate 10
    """
    with guarded_output() as stdout:
        experiment = load_experiment(file)
        directory = run_directory.create(out, experiment.name)
        run_directory.write_manifest(directory, experiment, file, "network")
        start = time.monotonic()
        network = Network(
            experiment,
            file.absolute(),
            directory,
            player,
            method=method,
            restarts=restarts,
            only=only or (),
            shared_run=name,
        )
        with _Display(experiment, network) as display:
            result = network.run(display.update)
        rounds = experiment.iterations + experiment.closing_rounds
        delivered = None if method else audit(experiment.edge_schedule, result.delivered, rounds)
        if delivered and result.mass_residual is not None:
            delivered |= {"late": len(delivered.pop("edge_mismatches")), "mass_residual": result.mass_residual}
        seconds = time.monotonic() - start
        demonstrations = _at_hand(experiment, [Path(bag) for bag in player.get("bags", [])])
        content = write_results(experiment, result.history, demonstrations, directory, seconds, delivered)
        if as_json:
            print_json(content, stdout)


def _at_hand(experiment: Experiment, bags: Sequence[Path]) -> Streams:
    """The demonstrations that learners had, for the test of constraints; none on a host without the bags."""
    bags = bags or [experiment.demonstrations.bag]
    if all(bag.exists() for bag in bags):
        return demonstrations_of(experiment, bags)
    console.print(
        f"{', '.join(map(str, bags))} is not on this host: constraints are told by the threshold on -omega",
        soft_wrap=True,
    )
    return {}


class _Display:
    """A live table on a terminal, a line every LINE_PERIOD seconds elsewhere."""

    def __init__(self, experiment: Experiment, network: Network) -> None:
        self._experiment, self._started = experiment, network.only or (*network.names, "the expert player")
        self._live = Live(console=console, refresh_per_second=4, transient=True) if console.is_terminal else None
        self._last = time.monotonic()

    def __enter__(self) -> Self:
        console.print(f"starting {', '.join(self._started)}", soft_wrap=True)
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def update(self, monitor: MonitorNode, _: Supervisor, news: Sequence[str]) -> None:
        """Show where the learners are, not more often than eyes can follow, and at once what died."""
        for words in news:
            console.print(words, style="yellow", soft_wrap=True)
        period = 0.25 if self._live else LINE_PERIOD
        if time.monotonic() - self._last < period:
            return
        self._last = time.monotonic()
        if self._live:
            self._live.update(live_table(self._experiment, monitor))
        else:
            console.print(plain_line(self._experiment, monitor), soft_wrap=True)
