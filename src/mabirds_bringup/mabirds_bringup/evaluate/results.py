"""After the learning: evaluate, and fill the run directory."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from mabirds_bringup.console import console, judges_table, progress_bar, summary_table
from mabirds_bringup.evaluate.evaluation import Evaluation, OnJudged, evaluate, summary, tasks_of
from mabirds_bringup.evaluate.policies import LearnerMetrics, PolicyJudge, Task
from mabirds_bringup.report.page import write_report
from mabirds_bringup.report.said import said
from mabirds_bringup.run import run_directory
from mabirds_bringup.run.certificate import TO_BE_JUDGED, Certificate
from mabirds_bringup.run.run_directory import JudgedRows
from mabirds_core.consensus.assumptions import validate
from mabirds_core.consensus.schedule import DeliveredEdges, EdgeSchedule, delivered_edges, edge_mismatches
from mabirds_core.errors import ScheduleError
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Streams


def audit(schedule: EdgeSchedule, delivered: DeliveredEdges, iterations: int) -> dict[str, Any]:
    """The delivered graph against the schedule, and its own smallest B.

    B is None where the graph connects not all learners, or where not all of ``iterations`` were heard of. In resilient
    mode mismatches are what was late or lost, and no mistake.
    """
    window = None
    if len(delivered) == iterations:
        slots = tuple(delivered_edges(schedule, delivered[n]) for n in range(1, iterations + 1))
        with suppress(ScheduleError):
            window = validate(EdgeSchedule(schedule.learners, slots, end="stop")).connectivity_window
    mismatches = edge_mismatches(schedule, delivered)
    return {"iterations": len(delivered), "edge_mismatches": mismatches, "connectivity_window": window}


class Delivery(NamedTuple):
    """The graph as it was delivered.

    Attributes
    ----------
    edges : DeliveredEdges
        Whose parameters each learner mixed, by iteration.
    audit : dict[str, Any]
        What ``audit`` says of it.
    """

    edges: DeliveredEdges
    audit: dict[str, Any]


def delivery_of(experiment: Experiment, edges: DeliveredEdges, mass_residual: float | None = None) -> Delivery:
    """Audit a network's graph; what differs from the schedule in resilient mode came late.

    ``mass_residual``: of resilient mode, where it is known.
    """
    found = audit(experiment.edge_schedule, edges, experiment.iterations + experiment.closing_rounds)
    if experiment.mixing.declares_members:
        found |= {"late": len(found.pop("edge_mismatches"))}
    return Delivery(edges, found if mass_residual is None else found | {"mass_residual": mass_residual})


@dataclass(frozen=True)
class _Results:
    """What came of a history, and whence it is told."""

    experiment: Experiment
    history: History
    demonstrations: Streams
    directory: Path
    seconds: float
    certificate: Certificate
    delivery: Delivery | None
    judge: PolicyJudge

    def evaluated(self, tasks: Sequence[Task], rows: JudgedRows, on_judged: OnJudged = lambda _: None) -> Evaluation:
        """Judge what of ``tasks`` is not known, and keep each row as soon as it is."""

        def keep(row: LearnerMetrics | None) -> None:
            on_judged(row)
            if row is not None:
                rows.add(row)

        known = [*rows.known.values()]
        return evaluate(self.experiment, self.history, self.demonstrations, keep, known, self.judge, tasks)

    def is_last(self, task: Task) -> bool:
        """Of what a learner or method ended with?"""
        return task.iteration == len(self.history[task.learner])

    def tell(self, evaluation: Evaluation, to_be_judged: int) -> dict[str, Any]:
        """Write, show and return the summary."""
        content = {**self.certificate.content, **summary(self.experiment, evaluation, self.seconds)}
        if self.delivery is not None:
            content["delivered_graph"] = self.delivery.audit
        if to_be_judged:
            content[TO_BE_JUDGED] = to_be_judged
        run_directory.write_json(self.directory / "summary.json", content)
        _show(content, self.directory)
        return content


def write_results(  # noqa: PLR0913, PLR0917 - all that a run directory tells
    experiment: Experiment,
    history: History,
    demonstrations: Streams,
    directory: Path,
    seconds: float,
    certificate: Certificate,
    delivery: Delivery | None = None,
    judge: PolicyJudge | None = None,
) -> dict[str, Any]:
    """Evaluate ``history``, write metrics.csv and summary.json, then figures and reports; show and return the summary.

    ``demonstrations``: each learner's. ``certificate``: what the history is worth. ``delivery``: of a network's run.
    ``judge``: one that is ready, if there is. Where it is interrupted, what was judged is kept for the next time.
    Verdicts of other planners take long, so that there is a summary without them before.
    """
    judge = judge or PolicyJudge(experiment)
    results = _Results(experiment, history, demonstrations, directory, seconds, certificate, delivery, judge)
    tasks = tasks_of(judge, history)
    with JudgedRows(directory) as rows, progress_bar() as bar:
        if any(task.planner for task in tasks):
            first = [task for task in tasks if not task.planner and (results.is_last(task) or task.row in rows.known)]
            results.tell(results.evaluated(first, rows), len(tasks) - len(first))
        progress = bar.add_task("evaluating", total=len(tasks))
        evaluation = results.evaluated(tasks, rows, lambda _: bar.advance(progress))
    run_directory.write_metrics(directory, evaluation)
    content = results.tell(evaluation, 0)

    from mabirds_bringup.report.figures import save_delivery, save_figures  # matplotlib takes a second to load

    told = said(directory, history)
    figures = save_figures(experiment, judge.game, history, evaluation, directory)
    if delivery is not None:
        figures |= save_delivery(experiment, delivery.edges, told, directory)
    write_report(directory, content, figures, told)
    console.print(f"results in {directory}; open {directory / 'report.html'}")
    return content


def _show(content: dict[str, Any], directory: Path) -> None:
    """The summary, for people; of one that is not the last only the rates."""
    console.print(summary_table(content))
    if left := content.get(TO_BE_JUDGED):
        console.print(f"{left} policies are still to be judged, by planners that took no part and on the way")
        return
    if (judges := judges_table(content)) is not None:
        console.print(judges)
    show_missing(content, directory)
    for mismatch in content.get("delivered_graph", {}).get("edge_mismatches", ()):
        console.print(f"the delivered graph differs: {mismatch}", style="red", soft_wrap=True)


def write_unevaluated(
    directory: Path, certificate: Certificate, seconds: float, delivery: Delivery | None = None
) -> dict[str, Any]:
    """Write, show and return the summary of a run that is to be judged later: whether it is whole."""
    content = {**certificate.content, "wall_seconds": seconds}
    if delivery is not None:
        content["delivered_graph"] = delivery.audit
    run_directory.write_json(directory / "summary.json", content)
    show_missing(content, directory)
    console.print(f"learned, not evaluated; `mabirds report {directory}` does it", soft_wrap=True)
    return content


def write_unjudged(directory: Path, certificate: Certificate, why: str) -> dict[str, Any]:
    """Write, show and return the summary of a run that cannot be judged, without rates. ``why``: in words."""
    content = certificate.content
    content["complete"], content["missing"] = False, [*certificate.missing, why]
    run_directory.write_json(directory / "summary.json", content)
    show_missing(content, directory)
    return content


def show_missing(summary: dict[str, Any], directory: Path) -> None:
    """Say loudly what is missing of a run, and what to do."""
    for words in summary["missing"]:
        console.print(f"incomplete: {words}", style="red", soft_wrap=True)
    if summary["missing"]:
        console.print(
            f"go on with `mabirds run --resume {directory}`, or see what is there with `mabirds report {directory}`",
            soft_wrap=True,
        )
