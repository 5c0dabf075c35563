"""The benchmark's tables, targets and pictures, from one row per problem, method and learner."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import polars as pl
from matplotlib.figure import Figure

from mabirds_bringup.bench.behaviour.constraint_rates import (
    constraint_rates,
    rates_by_level,
    trade_off_figure,
)
from mabirds_bringup.bench.behaviour.misses import missed, pictures
from mabirds_bringup.bench.behaviour.trial import COUNTING, MABIRDS
from mabirds_bringup.bench.tables import Section
from mabirds_bringup.report.templates import render
from mabirds_bringup.run.run_directory import write_json

TITLE = "Behaviour learned in random games, nothing tuned"
NOTE = (
    "Every game has its own map, starts, goals, network and schedule, drawn from the seed. Rates are exact; the worst"
    " learner of a game counts. Nats: held-out log likelihood per demonstration, below the better of the pooled optimum"
    " by L-BFGS and its best iterate. Decidable: constraints that experts without them would have touched in a"
    " learner's demonstrations with probability .99. Impossible: games in which a held-out demonstration has"
    " probability 0, so that there is no mean of nats. pooled_best_success: SR of the iterate of L-BFGS that is"
    " likeliest on held-out demonstrations; early stopping would give it."
)

SUCCESS, VIOLATION, LATE_SUCCESS, NATS_MEDIAN, NATS_95, DISTANCE = 0.99, 0.01, 0.98, 1.0, 2.0, 0.1
SHARE, FALSE_DISCOVERY, FOUND = 0.95, 0.05, 0.8


def by_problem(rows: pl.DataFrame) -> pl.DataFrame:
    """One row per method and problem: the worst of its learners in each measure."""
    excess = pl.max_horizontal("pooled_nats", "pooled_best_nats") - pl.col("nats")
    return rows.group_by("method", "seed", "experts", "learners", "schedule", maintain_order=True).agg(
        pl.min("success", "late_minimum"),
        pl.max("violation", "occupancy_distance"),
        excess.max().alias("excess_nats"),
    )


def targets(rows: pl.DataFrame) -> list[dict[str, Any]]:
    """What the default rule is to reach."""
    worst = by_problem(rows).filter(method=MABIRDS)
    rates = {row["method"]: row for row in constraint_rates(rows).to_dicts()}
    own, counting = rates[MABIRDS], rates[COUNTING]
    return [
        _target("share of games where all learners succeed", share_learned(worst), SHARE),
        _target("nats below the pooled optimum, median", worst["excess_nats"].median(), NATS_MEDIAN, at_most=True),
        _target("nats below, 95 %", worst["excess_nats"].quantile(0.95), NATS_95, at_most=True),
        _target("occupancy distance, median", worst["occupancy_distance"].median(), DISTANCE, at_most=True),
        _target("false discovery rate", own["false_discovery_rate"], FALSE_DISCOVERY, at_most=True),
        _target("shown features called constraints", own["called_used"], 0, at_most=True),
        _target("decidable constraints found", own["found"], FOUND),
        _target("found more than by counting", own["found"] - counting["found"], 0.0),
        _target(
            "false discoveries more than by counting",
            own["false_discovery_rate"] - counting["false_discovery_rate"],
            0.0,
            at_most=True,
        ),
    ]


def share_learned(worst: pl.DataFrame) -> float:
    """Share of the problems in which the worst learner's behaviour is as good as it is to be."""
    good = (
        (pl.col("success") >= SUCCESS) & (pl.col("violation") <= VIOLATION) & (pl.col("late_minimum") >= LATE_SUCCESS)
    )
    return float(worst.select(good.mean()).item())


def _target(name: str, value: Any, target: float, *, at_most: bool = False) -> dict[str, Any]:
    met = value <= target if at_most else value >= target
    return {"name": name, "value": float(value), "target": target, "at_most": at_most, "met": bool(met)}


def methods_table(rows: pl.DataFrame) -> list[dict[str, Any]]:
    """By method: means over problems of the worst learner, with 95 % bootstrap intervals; none of what is infinite."""
    table = []
    rates = {row["method"]: row for row in constraint_rates(rows).to_dicts()}
    for (method,), worst in by_problem(rows).group_by("method", maintain_order=True):
        shown: dict[str, Any] = {"method": method, "games": len(worst), **rates[str(method)]}
        for measure in ("success", "late_minimum", "violation", "excess_nats", "occupancy_distance"):
            values = worst[measure].drop_nulls().to_numpy()
            if len(values) and np.isfinite(values).all():
                low, high = bootstrap_interval(values)
                shown |= {measure: float(values.mean()), f"{measure}_low": low, f"{measure}_high": high}
        shown["impossible"] = int(worst["excess_nats"].is_infinite().sum())
        table.append(shown)
    return table


def bootstrap_interval(values: np.ndarray, draws: int = 2000) -> tuple[float, float]:
    """95 % percentile interval of the mean (Efron, 1979), from a fixed seed."""
    rng = np.random.default_rng(0)
    means = rng.choice(values, size=(draws, len(values))).mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def curves_figure(rows: pl.DataFrame) -> Figure:
    """Share of games up to each value, by method: the worst learner of each game."""
    worst = by_problem(rows).filter(pl.col("success").is_not_null())
    panels = {"success": "success rate", "late_minimum": "least success of the last 15", "excess_nats": "nats below"}
    figure, axes = plt.subplots(1, len(panels), figsize=(11, 3.2), layout="constrained")
    for axis, (measure, label) in zip(axes, panels.items(), strict=True):
        for (method,), of in worst.group_by("method", maintain_order=True):
            values = np.sort(of[measure].to_numpy())
            axis.step(values, np.arange(1, len(values) + 1) / len(values), where="post", label=str(method))
        axis.set(xlabel=f"{label} (worst learner)", ylabel="share of games", ylim=(0, 1.02))
    axes[2].set_xscale("symlog", linthresh=1.0)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    share = share_learned(worst.filter(method=MABIRDS))
    figure.suptitle(f"With nothing tuned, all learners succeed to the end in {share:.0%} of the games")
    return figure


def write_report(
    rows: Sequence[Mapping[str, Any]], directory: Path, command: str, machine: Mapping[str, Any], game_kind: str
) -> Any:
    """Fill ``directory``: results.parquet, summary.json, report.md, report.html, pictures; returns the summary."""
    frame = pl.DataFrame(rows, infer_schema_length=None)
    directory.mkdir(parents=True, exist_ok=True)
    frame.write_parquet(directory / "results.parquet")
    misses = missed(frame.filter(method=MABIRDS), SUCCESS, LATE_SUCCESS)
    figures = {"curves.png": curves_figure(frame), "constraints.png": trade_off_figure(frame)}
    shown = [*figures.items(), *pictures(misses, game_kind, rows[0]["demonstrations"])]
    for name, figure in shown:
        figure.savefig(directory / name, dpi=110)
        plt.close(figure)
    content: dict[str, Any] = {
        "command": command,
        "machine": dict(machine),
        "seeds": f"{frame['seed'].min()!s} to {frame['seed'].max()!s}",
        "targets": targets(frame),
        "methods": methods_table(frame),
        "levels": rates_by_level(frame).to_dicts(),
        "misses": misses,
    }
    write_json(directory / "summary.json", content)
    page = {
        "title": TITLE,
        "note": f"{rows[0]['demonstrations']} demonstrations per learner. {NOTE}",
        "pictures": [name for name, _ in shown],
    }
    sections = [
        _section("Targets", content["targets"]),
        _section("Methods: mean of the worst learner per game, 95 % bootstrap intervals", content["methods"]),
        _section("Constraints by confidence", content["levels"]),
        *([_section("Games missed", misses)] if misses else []),
    ]
    for suffix in ("md", "html"):
        text = render(f"bench.{suffix}.jinja", **content, page=page, sections=sections)
        (directory / f"report.{suffix}").write_text(text, encoding="utf-8")
    return content


def _section(title: str, rows: Sequence[Mapping[str, Any]]) -> Section:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    return Section(title, columns, [[_text(row.get(name)) for name in columns] for row in rows])


def _text(value: Any) -> str:
    return "" if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)
