"""``mabirds run``: the experiment as a network of processes."""

import os
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, Self

import typer
from rich.live import Live

from mabirds_bringup import exit_codes
from mabirds_bringup.commands.demonstrations import digest_at_hand
from mabirds_bringup.commands.options import CentralMethodName, Evaluation, Json, RunsDirectory
from mabirds_bringup.commands.player_options import LESS_THAN_ALL, takes_player_options
from mabirds_bringup.commands.report import report_on
from mabirds_bringup.console import console, ending_as_interrupted, guarded_output, print_json
from mabirds_bringup.evaluate.results import write_unjudged
from mabirds_bringup.run import run_directory
from mabirds_bringup.run.certificate import certify
from mabirds_bringup.run.judging import Judging
from mabirds_bringup.run.network import HostMovedError, Network
from mabirds_bringup.run.processes import PLAYER
from mabirds_bringup.run.size import shown_size
from mabirds_bringup.run.stored_run import NETWORK, RunPlan, StoredRun, begin, find_run, load_run, locked
from mabirds_bringup.run.supervisor import Supervisor
from mabirds_bringup.watch.live_table import Pace, live_table, plain_line
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.errors import ExperimentError, MabirdsError
from mabirds_core.experiment.file import Experiment, load_experiment

LINE_PERIOD = 2.0
"""Seconds between two lines of progress where the output is not a terminal."""


@takes_player_options(*LESS_THAN_ALL)
def run(  # noqa: PLR0913, PLR0917 - the options of a command
    player: dict[str, Any],
    file: Annotated[
        Path | None,
        typer.Argument(metavar="EXPERIMENT", help="Experiment file, such as ros_ws/config/patrol.yaml."),
    ] = None,
    method: CentralMethodName = None,
    restarts: Annotated[
        int, typer.Option(help="How often a node that died is started again; it goes on where it was.", min=0)
    ] = 3,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Start only this learner, or expert_player, on this host; may be given several times."),
    ] = None,
    name: Annotated[
        str,
        typer.Option(
            "--run", help="A name that all hosts of the run share. The same command goes on with a run of this name."
        ),
    ] = "",
    resume: Annotated[
        Path | None, typer.Option(help="Go on with the run of this directory, from its checkpoints.")
    ] = None,
    out: RunsDirectory = Path("runs"),
    evaluation: Evaluation = True,
    as_json: Json = False,
) -> int:
    """Run an experiment: one process per learner plus the expert player, until everything is learned.

    Example: mabirds run ros_ws/config/patrol.yaml --rate 10
    """
    plan = RunPlan(name, _absolute(player), method, restarts, tuple(only or ()))
    try:
        with guarded_output() as stdout, ending_as_interrupted():
            stored = _to_resume(load_run(resume.resolve()), file) if resume else _named_or_new(file, plan, out)
            if name and not resume and _has_all(stored):
                console.print(f"{stored.directory} is complete; there is nothing to go on with", soft_wrap=True)
                return _shown(stored.summary(), as_json, stdout)
            player = {**stored.plan.player, **_absolute(player)}
            with locked(stored.directory):
                content = _run(stored, player, restarts, evaluation=evaluation)
            return _shown(content, as_json, stdout)
    except HostMovedError as error:
        if stored.plan.method:
            raise
        same = ["--resume", stored.directory, "--restarts", restarts, *([] if evaluation else ["--no-evaluation"])]
        return _go_on(error, [] if resume or name else same, as_json)


def _has_all(stored: StoredRun) -> bool:
    """Is a run complete, and are there no other hosts that may still have to hear of it?"""
    return bool(stored.summary().get("complete")) and not stored.plan.only


def _go_on(error: HostMovedError, arguments: Sequence[object], as_json: bool) -> int:
    """Become a new process, by the same command unless there are ``arguments`` for another one."""
    console.print(f"{error}: doing so", style="yellow", soft_wrap=True)
    command = ["run", *map(str, arguments), *(["--json"] if as_json else [])] if arguments else sys.argv[1:]
    os.execv(sys.executable, [sys.executable, "-m", "mabirds_bringup", *command])  # noqa: S606 - this program itself


def _absolute(player: Mapping[str, Any]) -> dict[str, Any]:
    """The player's options as they must be written down: a run is gone on with from anywhere."""
    bags = {"bags": [str(Path(bag).absolute()) for bag in player["bags"]]} if "bags" in player else {}
    return {**player, **bags}


def _shown(content: Any, as_json: bool, stdout: Any) -> int:
    if as_json:
        print_json(content, stdout)
    return exit_codes.FINISHED if content["complete"] else exit_codes.INCOMPLETE


def _to_resume(stored: StoredRun, file: Path | None) -> StoredRun:
    """The run, if it can be gone on with."""
    if NETWORK not in stored.manifest:
        raise ExperimentError(f"--resume {stored.directory}: ran in process and keeps no checkpoints; start it again")
    if stored.plan.method:
        raise ExperimentError(
            f"--resume {stored.directory}: {stored.plan.method} is a central method and keeps no checkpoints; start it"
            " again"
        )
    if file and (found := load_experiment(file).digest) != stored.experiment.digest:
        raise ExperimentError(
            f"--resume {stored.directory}: is of another experiment (digest {stored.experiment.digest}) than {file}"
            f" ({found}); leave out the file, or start another run"
        )
    found_digest = digest_at_hand(stored.experiment, stored.file, stored.plan.bags, needed=_plays(stored.plan))
    if found_digest and stored.bag_digest and found_digest != stored.bag_digest:
        raise ExperimentError(
            f"{stored.experiment.demonstrations.bag}: holds other demonstrations (digest {found_digest}) than those"
            f" with which the run began ({stored.bag_digest}): bring the first bag back, or start another run"
        )
    run_directory.make_latest(stored.directory)
    console.print(f"going on with {stored.directory}", soft_wrap=True)
    return stored


def _plays(plan: RunPlan) -> bool:
    """Does the player run on this host?"""
    return not plan.only or PLAYER in plan.only


def _named_or_new(file: Path | None, plan: RunPlan, out: Path) -> StoredRun:
    """The run of this name on this host, or a new one, once all is checked that can be before anything starts."""
    if file is None:
        raise ExperimentError("Missing argument EXPERIMENT: give an experiment file, or --resume RUN_DIRECTORY")
    experiment = load_experiment(file)
    if strangers := sorted(set(plan.only) - {*experiment.learners, *filter(None, [plan.method]), PLAYER}):
        raise ExperimentError(f"--only {strangers[0]}: expected some of {[*experiment.learners, PLAYER]}")
    if found := find_run(out, experiment, plan) if plan.run else None:
        return found if _has_all(found) else _to_resume(found, None)
    bag_digest = digest_at_hand(experiment, file, plan.bags, needed=_plays(plan))
    return begin(out, experiment, file, bag_digest=bag_digest, plan=plan, method=plan.method)


def _run(stored: StoredRun, player: Mapping[str, object], restarts: int, *, evaluation: bool) -> dict[str, Any]:
    """Run, and write what came of it, be it whole or not."""
    experiment, start = stored.experiment, time.monotonic()
    network = Network(
        experiment,
        stored.file.absolute(),
        stored.directory,
        player,
        method=stored.plan.method,
        restarts=restarts,
        only=stored.plan.only,
        shared_run=stored.plan.run,
        bag_digest=stored.bag_digest or "",
    )
    shown_size(experiment, len([name for name in network.names if name in (network.only or network.names)]))
    try:
        with Judging(stored.directory) if evaluation else nullcontext() as judging:
            with _Display(experiment, network) as display:
                result = network.run(display.update)
            learned = time.monotonic() - start, result.departed, result.mass_residual
            judged = judging.results(*learned) if judging else None
        return judged or report_on(stored, *learned, evaluation=evaluation)
    except (KeyboardInterrupt, MabirdsError, OSError) as error:
        with stored.open_history() as kept:
            write_unjudged(stored.directory, certify(stored, kept), str(error) or "interrupted")
        raise


class _Display:
    """A live table on a terminal, a line every LINE_PERIOD seconds elsewhere."""

    def __init__(self, experiment: Experiment, network: Network) -> None:
        self._experiment, self._started = experiment, network.only or (*network.names, "the expert player")
        self._live = Live(console=console, refresh_per_second=4, transient=True) if console.is_terminal else None
        self._last, self._pace, self._printed = time.monotonic(), Pace(), ""

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
        self._pace.note(monitor)
        if self._live:
            self._live.update(live_table(self._experiment, monitor, self._pace))
        elif (line := plain_line(self._experiment, monitor)) != self._printed:
            self._printed = line
            left = self._pace.slowest(self._experiment.iterations)
            console.print(f"{line}; ETA {left}" if left else line, soft_wrap=True)
