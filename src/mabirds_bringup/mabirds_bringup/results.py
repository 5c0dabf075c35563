"""After the learning: evaluate, and fill the run directory."""

from pathlib import Path
from typing import Any

from mabirds_bringup import run_directory
from mabirds_bringup.console import console, progress_bar, summary_table
from mabirds_bringup.evaluation import evaluate, summary
from mabirds_bringup.report import write_report
from mabirds_core.experiment import Experiment
from mabirds_core.simulate import History


def write_results(experiment: Experiment, history: History, directory: Path, seconds: float) -> dict[str, Any]:
    """Evaluate ``history``, write metrics.csv, figures, report.html and summary.json; show and return the summary."""
    from mabirds_bringup.figures import save_figures  # matplotlib takes a second to load: not before it is needed

    total = sum(len(parameters) for parameters in history.values())
    with progress_bar() as bar:
        task = bar.add_task("evaluating", total=total)
        evaluation = evaluate(experiment, history, lambda: bar.advance(task))
    content = summary(experiment, evaluation, seconds)
    run_directory.write_metrics(directory, evaluation)
    write_report(directory, content, save_figures(experiment, history, evaluation, directory))
    run_directory.write_json(directory / "summary.json", content)
    console.print(summary_table(content))
    console.print(f"results in {directory}; open {directory / 'report.html'}")
    return content
