"""``mabirds schedule``: look at edge schedules, and write them."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
import yaml
from rich.table import Table

from mabirds_bringup.commands.options import ExperimentFile, Json
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_bringup.run.size import shown_size
from mabirds_core.consensus import generators
from mabirds_core.consensus.assumptions import validate
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.experiment.file import load_experiment

MAX_ROWS = 40
"""Slots that the terminal shows; --json holds them all."""

Kind = Literal["complete", "ring", "alternating_ring", "directed_ring", "random_matching", "gossip"]

schedule_app = typer.Typer(help="Check edge schedules and write them.")


@schedule_app.command()
def check(
    file: ExperimentFile,
    png: Annotated[Path | None, typer.Option(help="Draw the graph of every slot into this PNG.")] = None,
    as_json: Json = False,
) -> None:
    """Check an experiment's schedule: Assumptions 2 and 3, how fast learners agree, and what an iteration takes.

    Example: mabirds schedule check ros_ws/config/patrol.yaml --png schedule.png
    """
    with guarded_output() as stdout:
        experiment = load_experiment(file)
        schedule = experiment.edge_schedule  # refuses an impossible one, naming edge, slot or learners
        content = _content(schedule)
        console.print(_table(content))
        console.print(
            f"B = {content['connectivity_window']} iterations, epsilon = {content['smallest_weight']:.4f}; within B"
            f" iterations disagreement shrinks to {content['contraction']:.4f} of itself or less"
        )
        size = shown_size(experiment, len(experiment.learners))
        if png:
            _draw(schedule, png)
        if as_json:
            print_json({**content, "size": size and size.content}, stdout)


def _content(schedule: EdgeSchedule) -> dict[str, Any]:
    slots = []
    for number, edges in enumerate(schedule.slots, start=1):
        weights = schedule.weights(number)
        slots.append(
            {
                "edges": [[schedule.learners[u], schedule.learners[v]] for u, v in sorted(edges)],
                "row_sums": weights.sum(axis=1).tolist(),
                "column_sums": weights.sum(axis=0).tolist(),
                "smallest_weight": float(weights[weights > 0].min()),
            }
        )
    return {"learners": schedule.learners, "end": schedule.end, **asdict(validate(schedule)), "slots": slots}


def _table(content: dict[str, Any]) -> Table:
    table = Table(title=f"{len(content['slots'])} slots, then: {content['end']}")
    for column in ("slot", "edges", "row sums", "column sums", "smallest weight"):
        table.add_column(column)
    for number, slot in enumerate(content["slots"][:MAX_ROWS], start=1):
        edges = ", ".join(f"{sender} -> {receiver}" for sender, receiver in slot["edges"]) or "none"
        sums = (f"{min(slot[key]):.12g} to {max(slot[key]):.12g}" for key in ("row_sums", "column_sums"))
        table.add_row(str(number), edges, *sums, f"{slot['smallest_weight']:.4f}")
    return table


def _draw(schedule: EdgeSchedule, png: Path) -> None:
    from mabirds_bringup.report.schedule_figure import schedule_figure  # matplotlib takes a second to load

    schedule_figure(schedule).savefig(png, dpi=110, format="png")
    console.print(f"drawn in {png}", soft_wrap=True)


@schedule_app.command()
def make(
    kind: Annotated[Kind, typer.Argument(help="Which rule draws the slots.")],
    learners: Annotated[int, typer.Option(help="How many: learner_1, learner_2, ...", min=1, max=1000)] = 4,
    slots: Annotated[int, typer.Option(help="Slots of a random schedule.", min=1, max=100_000)] = 16,
    seed: Annotated[int, typer.Option(help="Of a random schedule.", min=0)] = 0,
    out: Annotated[Path | None, typer.Option(help="File to write; default: standard output.")] = None,
) -> None:
    """Write learners and schedule of an experiment file, slot by slot, ready to be edited and pasted.

    Example: mabirds schedule make random_matching --learners 8 --slots 20 --seed 1
    """
    schedule = _made(kind, [f"learner_{number}" for number in range(1, learners + 1)], slots, seed)
    validate(schedule)
    written = {
        "kind": "slots",
        "slots": [[[schedule.learners[u], schedule.learners[v]] for u, v in sorted(slot)] for slot in schedule.slots],
        "end": schedule.end,
    }
    text = yaml.safe_dump({"learners": list(schedule.learners), "schedule": written}, default_flow_style=None)
    if out:
        out.write_text(text, encoding="utf-8")
        console.print(f"written to {out}", soft_wrap=True)
    else:
        typer.echo(text, nl=False)


def _made(kind: Kind, learners: list[str], slots: int, seed: int) -> EdgeSchedule:
    match kind:
        case "complete":
            return generators.static(learners, generators.complete_edges(len(learners)))
        case "ring":
            return generators.static(learners, generators.ring_edges(len(learners)))
        case "alternating_ring":
            return generators.alternating_ring(learners)
        case "directed_ring":
            return generators.directed_ring(learners)
        case "random_matching":
            return generators.random_matching(learners, slots, seed)
        case "gossip":
            return generators.gossip(learners, slots, seed)
