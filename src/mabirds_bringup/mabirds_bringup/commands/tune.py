"""``mabirds tune``: settings chosen on the recordings that learners have."""

import os
from pathlib import Path
from typing import Annotated

import typer
import yaml
from rich.table import Table

from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.options import ExperimentFile, Json
from mabirds_bringup.console import console, guarded_output, print_json, progress_bar
from mabirds_bringup.tuning.choices import changed, drawn, tried
from mabirds_bringup.tuning.search import Trial, folds_of, settings_of, tried_out
from mabirds_core.experiment.file import Experiment, load_experiment, without_defaults
from mabirds_core.texts import sanitize


def tune(
    file: ExperimentFile,
    out: Annotated[Path, typer.Option(help="The experiment file to write.")],
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--try",
            metavar="PATH=VALUES",
            help="A setting, and values with commas, or LOW..HIGH; several times. Without: when to stop, alone.",
        ),
    ] = None,
    trials: Annotated[int, typer.Option(help="Settings that are tried, at most.", min=1, max=10_000)] = 12,
    folds: Annotated[int, typer.Option(help="Blocks of demonstrations, of which each judges once.", min=2)] = 3,
    as_json: Json = False,
) -> None:
    """Choose settings, and when to stop, by cross-validation on the demonstrations that learners have.

    Example: mabirds tune mine/experiment.yaml --try algorithm.policy.temperature=0.3..3 --out mine/tuned.yaml
    """
    with guarded_output() as stdout:
        experiment = load_experiment(file)
        asked = [tried(text) for text in settings or ()]
        changes = drawn(asked, trials, experiment.seed) if asked else [{}]
        for change in changes:
            changed(experiment, change)  # that none is refused when others have been learned already
        cut = list(folds_of(demonstrations_of(experiment), folds))
        with progress_bar() as bar:
            task = bar.add_task("learning", total=len(changes) * folds)
            done = [tried_out(experiment, change, cut, lambda: bar.advance(task)) for change in changes]
        best = max(done, key=lambda trial: trial.score)
        write(out, experiment, best)
        console.print(trials_table(done, best))
        console.print(f"wrote {out}; learn it: mabirds simulate {out}", soft_wrap=True)
        if as_json:
            chosen = dict(settings_of(best, experiment))
            print_json({"out": str(out), "chosen": chosen, "trials": [_content(of) for of in done]}, stdout)


def write(out: Path, experiment: Experiment, best: Trial) -> None:
    """The experiment file with what was chosen, its bag told from where the file is."""
    tuned = changed(experiment, settings_of(best, experiment))
    content = without_defaults(tuned)
    content["demonstrations"]["bag"] = os.path.relpath(tuned.demonstrations.bag, out.resolve().parent)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def trials_table(done: list[Trial], best: Trial) -> Table:
    """A line per trial; the best one is marked."""
    table = Table(title="Nats of a demonstration left out, by settings")
    for column in ("", "settings", "iterations", "nats"):
        table.add_column(column)
    for trial in done:
        words = ", ".join(f"{path}={value}" for path, value in trial.changes.items()) or "as in the file"
        mark = "*" if trial is best else ""
        table.add_row(mark, sanitize(words, 300), str(trial.iterations), f"{trial.score:.3f}")
    return table


def _content(trial: Trial) -> dict[str, object]:
    scores = {str(stop): float(score) for stop, score in zip(trial.stops, trial.scores, strict=True)}
    return {"changes": dict(trial.changes), "iterations": trial.iterations, "nats": trial.score, "by_stop": scores}
