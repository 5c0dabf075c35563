"""The judging process of a run: it judges rows while learners go on, and writes the results once they have ended.

    python -m mabirds_bringup.evaluate.beside RUN_DIRECTORY

``mabirds run`` starts it (``run/judging.py``). What is still to be judged waits in files of the run: it needs no more
memory however far behind it is. One line on standard input, the arguments of ``report_on`` as JSON, says that the
learning has ended; the summary is then printed as JSON. It ends with who started it, or with its input.
"""

import json
import select
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from itertools import takewhile
from pathlib import Path

import mabirds_bringup.report.figures  # noqa: F401 - takes a second to load, which is over when results are asked for
from mabirds_bringup.commands.demonstrations import demonstrations_at_hand
from mabirds_bringup.commands.report import Ready, report_on
from mabirds_bringup.console import guarded_output, print_json
from mabirds_bringup.evaluate.evaluation import judge_finals
from mabirds_bringup.evaluate.policies import PolicyJudge, Task, ToldConfidences
from mabirds_bringup.priority import set_niceness
from mabirds_bringup.run.run_directory import JudgedRows
from mabirds_bringup.run.stored_run import StoredRun, load_run
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import CheckpointError, MabirdsError
from mabirds_learner.checkpoint import CONFIDENCES
from mabirds_learner.parameters_log import ParametersLog, VectorLog
from mabirds_msgs_py.supervised import end_with_supervisor

LOW = 10
"""Niceness of the thread that judges: all others go before it."""

PERIOD = 0.05
"""Seconds between two looks at what was learned."""

EXIT_FAILED = 2
"""It could not judge; who started it then does, and meets what was wrong."""


class Beside(threading.Thread):
    """Judges what is learned, as far as nobody else needs the processor.

    Parameters
    ----------
    stored : StoredRun
        The run.
    """

    def __init__(self, stored: StoredRun) -> None:
        super().__init__(daemon=True)
        self._stored, self._ended = stored, threading.Event()
        self.ready: Ready | None = None

    def run(self) -> None:
        """Judge until all is judged, or until the end. What goes wrong is told by who writes the results."""
        set_niceness(LOW)
        with suppress(MabirdsError, OSError), self._stored.open_history() as kept:
            judge = PolicyJudge(self._stored.experiment)
            judge.prepare()
            self.ready = Ready(judge, demonstrations_at_hand(self._stored.experiment, self._stored.plan.bags))
            with JudgedRows(self._stored.directory) as rows:
                self._judge_rows(judge, kept.parameters, rows)

    def _judge_rows(self, judge: PolicyJudge, parameters: Mapping[str, ParametersLog], rows: JudgedRows) -> None:
        iterations = judge.game.judge.eval_iterations(self._stored.last)
        waiting = [(n, name) for n in iterations for name in parameters if (name, n) not in rows.known]
        while waiting and not self._ended.is_set():
            if (found := _due(waiting, parameters)) is None:
                self._ended.wait(PERIOD)
                continue
            waiting.remove(found)
            n, name = found
            rows.add(judge.row(Task(name, n, parameters[name][n])))

    def end(self) -> Ready | None:
        """Judge no more, and hand over what is ready."""
        self._ended.set()
        set_niceness(0, self.native_id or 0)  # somebody waits for it
        self.join()
        return self.ready


def _due(waiting: Sequence[tuple[int, str]], parameters: Mapping[str, ParametersLog]) -> tuple[int, str] | None:
    """The first that is learned by now."""
    for log in parameters.values():
        log.look_again()
    newest = max(log.newest for log in parameters.values())
    reached = takewhile(lambda task: task[0] <= newest, waiting)
    return next(((n, name) for n, name in reached if n in parameters[name]), None)


def anticipate(stored: StoredRun, ready: Ready) -> None:
    """Judge the last parameters while the processes of the run are stopped.

    Parameters
    ----------
    stored : StoredRun
        All of which is learned.
    ready : Ready
        Keeps what is found.
    """
    if final := _final(stored):
        ready.judge.told = told_confidences(stored, ready.judge)
        judge_finals(ready.judge, final, ready.demonstrations)


def _final(stored: StoredRun) -> dict[str, Parameters]:
    """What learners ended with; empty where it is not known of all."""
    with stored.open_history() as kept:
        whole = all(stored.last in log for log in kept.parameters.values())
        return {name: log[stored.last] for name, log in kept.parameters.items()} if whole else {}


def told_confidences(stored: StoredRun, judge: PolicyJudge) -> dict[str, ToldConfidences]:
    """What learners of this host have written down of their constraints, which takes as long to find as to learn.

    Parameters
    ----------
    stored : StoredRun
        The run.
    judge : PolicyJudge
        Of its experiment.

    Returns
    -------
    dict[str, ToldConfidences]
        Of those who have ended and told.
    """
    size, told = len(judge.game.cost_features.names), dict[str, ToldConfidences]()
    for name, parameters in _final(stored).items():
        if (file := stored.checkpoints / name / CONFIDENCES).is_file():
            with suppress(CheckpointError), closing(VectorLog(file, size, stored.digest)) as log:
                if stored.last in log:
                    told[name] = ToldConfidences(parameters, log[stored.last])
    return told


def main(directory: Path) -> int:
    """Judge until a line comes, then write the results; the exit code."""
    end_with_supervisor()
    with guarded_output() as stdout:
        try:
            stored = load_run(directory)
            beside = Beside(stored)
            beside.start()
            while beside.is_alive() and not select.select([sys.stdin], [], [], PERIOD)[0]:
                pass
            if not beside.is_alive() and beside.ready:
                anticipate(stored, beside.ready)
            if not (request := sys.stdin.readline()):
                return EXIT_FAILED  # nobody wants results
            if ready := beside.end():
                ready.judge.told = told_confidences(stored, ready.judge)
            print_json(report_on(stored, **json.loads(request), ready=ready), stdout)
        except MabirdsError:
            return EXIT_FAILED
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
