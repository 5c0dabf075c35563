"""``mabirds evaluate``: a run judged by recordings that nobody learned from, beside what learns nothing."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.options import Json
from mabirds_bringup.commands.report import RunDirectory
from mabirds_bringup.console import console, guarded_output, print_json, progress_bar
from mabirds_bringup.evaluate.recordings import Row, judged_by_recordings
from mabirds_bringup.run import run_directory
from mabirds_bringup.run.stored_run import load_run
from mabirds_core.algorithm.memory import stacked
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.bag_survey import survey
from mabirds_msgs_py.errors import BagError

FILE = "held_out.json"
"""In the run directory."""


def evaluate(
    directory: RunDirectory,
    bag: Annotated[Path, typer.Option(help="Bag of demonstrations that nobody learned from.")],
    samples: Annotated[int, typer.Option(help="k: trajectories from each start.", min=1, max=1000)] = 20,
    as_json: Json = False,
) -> None:
    """Judge a run by demonstrations that nobody learned from, beside baselines that learn nothing.

    Example: mabirds evaluate runs/latest --bag mine/held_out
    """
    with guarded_output() as stdout:
        stored = load_run(directory.resolve())
        with stored.open_history() as kept:
            final = {name: parameters[-1] for name, parameters in kept.without_gap().items() if parameters}
        if not final:
            raise BagError(f"{directory}: nothing was learned yet; wait until the run ends")
        held_out = held_out_of(stored.experiment, bag)
        training = demonstrations_of(stored.experiment, stored.plan.bags)
        with progress_bar() as bar:
            task = bar.add_task("judging", total=len(final) + 5)
            rows = judged_by_recordings(
                stored.experiment, final, training, held_out, samples, lambda _: bar.advance(task)
            )
        console.print(forecasts_table(rows, len(held_out.states), samples))
        content: dict[str, Any] = {
            "bag": str(bag),
            "demonstrations": len(held_out.states),
            "samples": samples,
            "rows": as_content(rows),
        }
        run_directory.write_json(stored.directory / FILE, content)
        if as_json:
            print_json(content, stdout)


def held_out_of(experiment: Experiment, bag: Path) -> Trajectories:
    """All demonstrations of a bag, whichever learners they are for.

    Raises BagError where it has none.
    """
    learners = {name for topic in survey(bag).demonstrations.values() for name in topic.learners}
    with DemonstrationBag(bag, build_game(experiment), sorted(learners)) as reader:
        found = [demonstration for name in sorted(learners) for demonstration in reader.trajectories(name)]
    if not found:
        raise BagError(f"{bag}: has no demonstrations; set held_out in the rules of the import")
    return stacked(found)


def as_content(rows: dict[str, Row]) -> dict[str, Any]:
    """Rows as JSON."""
    return {
        name: {key: value._asdict() if hasattr(value, "_asdict") else value for key, value in row._asdict().items()}
        for name, row in rows.items()
    }


def forecasts_table(rows: dict[str, Row], demonstrations: int, samples: int) -> Table:
    """The table for the terminal: intervals of 95 % in brackets."""
    title = f"{demonstrations} held-out demonstrations, {samples} trajectories from each start"
    table = Table(title=title, caption="nats: by which a step is likelier than under the uniform policy")
    conflicts = list(next(iter(rows.values())).conflicts)
    for column in ("", "nats a step", "ADE [m]", f"best of {samples}", "FDE [m]", f"best of {samples}", *conflicts):
        table.add_column(column, min_width=12 if not column else None)
    for name, row in rows.items():
        cells = ["" if value is None else str(value).replace(" ", "\n", 1) for value in row[:5]]
        table.add_row(name, *cells, *(f"{row.conflicts[what]:.3f}" for what in conflicts))
    return table
