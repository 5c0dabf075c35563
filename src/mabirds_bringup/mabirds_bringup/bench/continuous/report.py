"""The benchmark's report: Table 3, the closing rounds, what pillars cost, and what that is to show."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars as pl

from mabirds_bringup.bench.cases import MABIRDS
from mabirds_bringup.bench.continuous.cases import LATTICE, SOFT_ACTOR_CRITIC, VARIATIONS
from mabirds_bringup.bench.continuous.figures import save_figures
from mabirds_bringup.bench.report import Benchmark, Page
from mabirds_bringup.bench.report import write_report as write_page
from mabirds_bringup.bench.summary import MEASURES, Measure, at_end, at_last_update, mean_range, share_above_zero
from mabirds_bringup.bench.tables import NAME, TIMES, WORK, Column, Section, number, rate, section
from mabirds_bringup.bench.targets import Limit, Limits, mean_of, slower_than_learners
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.drones.study import drone_game

NOTE = (
    "Mean ± half the range over the seeds. CVR and SR are shares of {flights} flights of the policy that theta and"
    " omega mean, found near-exactly (for the times to a success rate, {fewer} flights per iteration); an actor's are"
    " those of the network that the learner found last. STPOI: time per online iteration; 50% ST, 90% ST: time of"
    " updates until SR first is that high; each divided by the smallest of its column. Learners work at the same time:"
    " the time of one's own updates counts. Gradient steps, policy solves and seconds are per online iteration of one"
    " learner on one thread. Memory is the peak of the process that learned; that of a network holds all its learners."
    " Targets are the paper's means for MA-BIRDS; for other methods mean + half-width of CVR, mean - half-width of SR."
    " A pillar whose cost is near 0 is one that neither demonstrations nor imagined flights came near; it is dearer"
    " than the ways flown only where those have a negative cost."
)

AT_MOST = {
    MABIRDS: 0.025,
    "BICS": 0.015 + 0.015,
    "FTL": 0.015 + 0.010,
    "DLM": 0.020 + 0.015,
    "ME-gradient": 0.013 + 0.013,
}
"""Violation rates: the paper's Table 3, mean + half-width."""

AT_LEAST = {
    MABIRDS: 0.974,
    "BICS": 0.979 - 0.020,
    "FTL": 0.981 - 0.018,
    "DLM": 0.975 - 0.015,
    "ME-gradient": 0.980 - 0.018,
}
"""Success rates: the same table, mean - half-width; of MA-BIRDS the mean."""


RATES = (
    Limit("violation_rate", mean_of("violation_rate"), AT_MOST, at_most=True),
    Limit("success_rate", mean_of("success_rate"), AT_LEAST),
    Limit("actor's violation_rate", mean_of("actor_violation_rate"), AT_MOST, at_most=True),
    Limit("actor's success_rate", mean_of("actor_success_rate"), AT_LEAST),
)
COSTS = (
    Limit("share of pillars that cost more than ways flown", pl.col("dear_pillars"), {MABIRDS: 1.0}),
    Limit("share of seeds where closeness costs", pl.col("dear_closeness"), {MABIRDS: 1.0}),
)


def group_limits(group: str, name: pl.Expr, most_seconds: float) -> Iterator[Limits]:
    """Rates, times, and what learned costs say; ``most_seconds``: per iteration of a learner."""
    seconds = Limit("seconds per iteration", pl.col("iteration_seconds"), {MABIRDS: most_seconds}, at_most=True)
    for limits in (RATES, (seconds,), (slower_than_learners(),), COSTS):
        yield Limits(group, limits, name)


BENCHMARK = Benchmark(
    groups={
        LATTICE: "Table 3: all methods on the same demonstrations, policies found on a lattice",
        SOFT_ACTOR_CRITIC: "Policies found by soft actor-critic",
        VARIATIONS: "Variations",
    },
    measures={
        **MEASURES,
        "updated_violation_rate": Measure(at_last_update("violation_rate")),
        "updated_success_rate": Measure(at_last_update("success_rate")),
        **{
            metric: Measure(at_end(metric))
            for metric in (
                "actor_violation_rate",
                "actor_success_rate",
                "consensus_theta",
                "consensus_omega",
                "policy_distance",
            )
        },
        "peak_memory": Measure(at_end("peak_memory"), pl.Expr.mean),
        # No pillar is no pillar too cheap.
        "dear_pillars": Measure(share_above_zero("pillar_dearer").fill_null(1.0), pl.Expr.mean),
        "dear_closeness": Measure(share_above_zero("closeness"), pl.Expr.mean),
    },
    columns=(
        NAME,
        rate("CVR", "violation_rate"),
        rate("SR", "success_rate"),
        rate("actor's CVR", "actor_violation_rate", optional=True),
        rate("actor's SR", "actor_success_rate", optional=True),
        *TIMES,
        *WORK,
        Column("memory [MB]", pl.col("peak_memory"), number(".0f")),
    ),
    limits=(
        *group_limits(LATTICE, pl.col("name"), 0.5),
        *group_limits(SOFT_ACTOR_CRITIC, pl.format("soft actor-critic, {}", "name"), 3.0),
    ),
    packages=("numpy", "scipy", "torch"),
)

CLOSING = (
    Column("", pl.format("{} ({})", "name", "group")),
    rate("CVR, last update", "updated_violation_rate"),
    rate("SR, last update", "updated_success_rate"),
    rate("CVR, end", "violation_rate"),
    rate("SR, end", "success_rate"),
    Column("distance of theta", mean_of("consensus_theta"), number(".1e")),
    Column("of omega", mean_of("consensus_omega"), number(".1e")),
    rate("of flights", "policy_distance"),
)

PILLARS = (
    Column("pillar", pl.col("place")),
    Column("drone", pl.col("drone") + 1),
    rate("touching it", "pillar_inside"),
    rate("its rim", "pillar_rim"),
    rate("ways flown", "flown"),
    Column("dearer", pl.format("{} of {}", "dearer", "count")),
)


def closing_section(rows: pl.DataFrame) -> Section:
    """What the closing rounds change, a line per learner of a network."""
    learners = rows.filter(pl.col("learner").str.starts_with("learner"))
    return section("The closing rounds, and how far the learners are apart", learners, CLOSING)


def pillar_section(settings: DroneSettings, results: pl.DataFrame, group: str) -> Section:
    """LearnedCosts costs of every pillar for every drone, over learners of MA-BIRDS in the group and seeds."""
    title = f"What MA-BIRDS takes for the cost of a pillar ({group}, mean ± half the range over learners and seeds)"
    places = [f"({pillar.centre[0]:g}, {pillar.centre[1]:g}) m" for pillar in settings.obstacles]
    costs = _pillar_costs(results.filter(group=group, label=MABIRDS))
    return section(
        title, costs.with_columns(place=pl.lit(pl.Series(places, dtype=pl.String)).gather("pillar")), PILLARS
    )


def _pillar_costs(results: pl.DataFrame) -> pl.DataFrame:
    """A row per pillar and drone, each counted from 0."""
    parts = pl.col("metric").str.extract_groups(r"^(?<array>\w+)\[(?<drone>\d+)(?:,(?<pillar>\d+))?\]$")
    entries = results.with_columns(parts.alias("parts")).unnest("parts").cast({"drone": pl.Int64, "pillar": pl.Int64})
    inside, rim, dearer, flown = (
        pl.col("value").filter(array=array) for array in ("pillar_inside", "pillar_rim", "pillar_dearer", "flown")
    )
    by_pillar = (
        entries.drop_nulls("pillar")
        .group_by("pillar", "drone")
        .agg(
            pillar_inside=mean_range(inside),
            pillar_rim=mean_range(rim),
            dearer=dearer.sum().cast(pl.Int64),
            count=dearer.count(),
        )
    )
    of_ways = entries.group_by("drone").agg(flown=mean_range(flown))
    return by_pillar.join(of_ways, on="drone").sort("pillar", "drone")


def sections(main: Experiment, results: pl.DataFrame) -> Iterator[Section]:
    """The groups' tables, then those of the closing rounds and of pillars."""
    rows = BENCHMARK.rows(results)
    yield from BENCHMARK.sections(rows)
    yield closing_section(rows)
    for group in (LATTICE, SOFT_ACTOR_CRITIC):
        if len(rows.filter(group=group)):
            yield pillar_section(drone_game(main).settings, results, group)


def write_report(
    main: Experiment, sac: Experiment | None, results: pl.DataFrame, directory: Path, command: str, flights: int
) -> dict[str, Any]:
    """Fill ``directory``; returns what --json prints.

    ``sac``: the experiment by soft actor-critic. ``flights``: that judged the last policies.
    """
    page = Page(
        f"{main.name}: MA-BIRDS and central methods, {main.iterations} demonstrations per learner",
        NOTE.format(flights=flights, fewer=flights // 10),
        save_figures(main, sac, results, directory),
        [*sections(main, results)],
        BENCHMARK.targets(BENCHMARK.rows(results)),
        {"flights": flights},
    )
    return write_page(BENCHMARK, results, directory, command, page)
