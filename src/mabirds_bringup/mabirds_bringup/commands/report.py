"""``mabirds report`` and ``mabirds check``: of any run directory, at any time."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from mabirds_bringup import exit_codes
from mabirds_bringup.commands.demonstrations import demonstrations_at_hand, digest_at_hand
from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_bringup.evaluate.policies import PolicyJudge
from mabirds_bringup.evaluate.results import delivery_of, write_results, write_unevaluated, write_unjudged
from mabirds_bringup.run.certificate import certify, contradictions
from mabirds_bringup.run.stored_run import StoredRun, load_run
from mabirds_core.experiment.simulate import Streams

RunDirectory = Annotated[Path, typer.Argument(metavar="RUN", help="Run directory, such as runs/latest.")]


def report(
    directories: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run directories, such as runs/latest.")],
    out: Annotated[Path, typer.Option(help="Directory of the comparison, where there are several runs.")] = Path(
        "comparison"
    ),
    as_json: Json = False,
) -> int:
    """Make the report of a run from what is there: of one that was interrupted, or that is still under way.

    Several runs, each of which has its report, are compared.

    Example: mabirds report runs/latest
    """
    if len(directories) > 1:
        return _compare(directories, out, as_json=as_json)
    (directory,) = directories
    with guarded_output() as stdout:
        stored = load_run(directory.resolve())
        before = stored.summary()
        residual = before.get("delivered_graph", {}).get("mass_residual")
        content = report_on(stored, before.get("wall_seconds", 0.0), before.get("departed", ()), residual)
        if as_json:
            print_json(content, stdout)
    return exit_codes.FINISHED if content["complete"] else exit_codes.INCOMPLETE


def _compare(directories: Sequence[Path], out: Path, *, as_json: bool) -> int:
    from mabirds_bringup.report.comparison import load_judged, write_comparison

    with guarded_output() as stdout:
        runs = [load_judged(directory.resolve()) for directory in directories]
        write_comparison(runs, out)
        console.print(f"{len(runs)} runs compared in {out / 'report.html'}", soft_wrap=True)
        if as_json:
            print_json({"runs": {run.name: run.summary for run in runs}}, stdout)
    return exit_codes.FINISHED


class Ready(NamedTuple):
    """What results are written with, which takes a while to make."""

    judge: PolicyJudge
    demonstrations: Streams


def report_on(
    stored: StoredRun,
    seconds: float,
    departed: Collection[str] = (),
    mass_residual: float | None = None,
    *,
    evaluation: bool = True,
    ready: Ready | None = None,
) -> dict[str, Any]:
    """Judge what is known of a run up to the first gap, if something is of every learner.

    ``seconds``: it took. ``mass_residual``: of resilient mode, if at hand. Without ``evaluation`` it is only
    said what is known. ``ready``: what is at hand already, if anything is.
    """
    with stored.open_history() as kept:
        certificate, history = certify(stored, kept, departed), kept.without_gap()
        graph = None if stored.plan.method or not stored.plan.run else kept.delivered()
    if unknown := [name for name, parameters in history.items() if not parameters]:
        why = f"nothing is known of iteration 1 of {', '.join(unknown)}"
        return write_unjudged(stored.directory, certificate, why)
    delivery = None if graph is None else delivery_of(stored.experiment, graph, mass_residual)
    if not evaluation:
        return write_unevaluated(stored.directory, certificate, seconds, delivery)
    judge, demonstrations = ready or (None, demonstrations_at_hand(stored.experiment, stored.plan.bags))
    return write_results(
        stored.experiment, history, demonstrations, stored.directory, seconds, certificate, delivery, judge
    )


def check(directory: RunDirectory, as_json: Json = False) -> int:
    """Check a run directory: digests, that it is whole, and that its summary is that of its files.

    Example: mabirds check runs/latest
    """
    with guarded_output() as stdout:
        stored = load_run(directory.resolve())
        summary = stored.summary()
        with stored.open_history() as kept:
            certificate = certify(stored, kept, summary.get("departed", ()))
        wrong = contradictions(summary, certificate) if summary else ["there is no summary.json"]
        found = digest_at_hand(stored.experiment, stored.file, stored.plan.bags, needed=False)
        if found and stored.bag_digest and found != stored.bag_digest:
            wrong.append(f"{stored.experiment.demonstrations.bag}: holds other demonstrations, digest {found}")
        for words in [*certificate.missing, *wrong]:
            console.print(f"{stored.directory}: {words}", style="red", soft_wrap=True)
        sound = not (certificate.missing or wrong)
        if sound:
            ends = ", ".join(f"{name} {n}" for name, n in certificate.last_iterations.items())
            console.print(f"{stored.directory}: whole, and its summary is that of its files; {ends}", soft_wrap=True)
        if as_json:
            print_json({"sound": sound, "wrong": wrong, **certificate.content}, stdout)
    return exit_codes.FINISHED if sound else exit_codes.INCOMPLETE
