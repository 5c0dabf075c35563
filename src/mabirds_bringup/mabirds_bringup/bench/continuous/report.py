"""The benchmark's report."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mabirds_bringup.bench import report
from mabirds_bringup.bench.continuous.cases import LATTICE, SOFT_ACTOR_CRITIC, VARIATIONS
from mabirds_bringup.bench.continuous.figures import save_figures
from mabirds_bringup.bench.continuous.outcome import Outcome
from mabirds_bringup.bench.continuous.tables import (
    CLOSING_COLUMNS,
    PILLAR_COLUMNS,
    closing_table,
    pillar_table,
    rows,
    table,
)
from mabirds_bringup.bench.continuous.targets import targets
from mabirds_bringup.bench.report import Page, Section, machine
from mabirds_bringup.bench.targets import COLUMNS as TARGET_COLUMNS
from mabirds_bringup.bench.targets import Target, target_lines
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.drones.study import drone_game

GROUPS = {
    LATTICE: "Table 3: all methods on the same demonstrations, policies found on a lattice",
    SOFT_ACTOR_CRITIC: "Policies found by soft actor-critic",
    VARIATIONS: "Variations",
}
NOTE = (
    "Mean ± half the range over the seeds. CVR and SR are shares of {flights} flights of the policy that theta and"
    " omega mean, found near-exactly (for the times to a success rate, {fewer} flights an iteration); an actor's are"
    " those of the network that the learner found last. STPOI: time per online iteration; 50% ST, 90% ST: time of"
    " updates until SR first is that high; each divided by the smallest of its column. Learners work at the same time:"
    " the time of one's own updates counts. Gradient steps, policy solves and seconds are per online iteration of one"
    " learner on one thread. Memory is the peak of the process that learned; that of a network holds all its learners."
    " Targets are the paper's means for MA-BIRDS; for other methods mean + half-width of CVR, mean - half-width of SR."
    " A pillar whose cost is near 0 is one that neither demonstrations nor imagined flights came near; it is dearer"
    " than the ways flown only where those have a negative cost."
)


def write_report(
    main: Experiment, sac: Experiment | None, outcomes: Sequence[Outcome], directory: Path, command: str, flights: int
) -> dict[str, Any]:
    """Fill ``directory``; returns what --json prints.

    ``sac``: the experiment by soft actor-critic. ``flights``: that judged the last policies.
    """
    found = targets(outcomes)
    content = {
        "command": command,
        "machine": machine("numpy", "scipy", "torch"),
        "flights": flights,
        "seeds": sorted({one.seed for one in outcomes}),
        "results": [asdict(row) for row in rows(outcomes)],
        "targets": [target.as_dict() for target in found],
    }
    title = f"{main.name}: MA-BIRDS and central methods, {main.iterations} demonstrations a learner"
    note = NOTE.format(flights=flights, fewer=flights // 10)
    pictures = save_figures(main, sac, outcomes, directory)
    page = Page(title, note, list(_sections(main, outcomes, found)), pictures)
    report.write_report(directory, content, outcomes, page)
    return content


def _sections(main: Experiment, outcomes: Sequence[Outcome], found: Sequence[Target]) -> Iterator[Section]:
    of = rows(outcomes)
    for group, title in GROUPS.items():
        chosen = [row for row in of if row.group == group]
        if chosen:
            yield Section(title, *table(chosen))
    yield Section("The closing rounds, and how far the learners are apart", CLOSING_COLUMNS, closing_table(of))
    for group in (LATTICE, SOFT_ACTOR_CRITIC):
        own = [one for one in outcomes if one.group == group]
        if own:
            title = (
                f"What MA-BIRDS takes for the cost of a pillar ({group}, mean ± half the range over learners and seeds)"
            )
            yield Section(title, PILLAR_COLUMNS, list(pillar_table(drone_game(main).settings, own)))
    yield Section("Targets", TARGET_COLUMNS, target_lines(found))
