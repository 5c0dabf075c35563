"""What came of a run, in sentences."""

from collections.abc import Iterator, Mapping
from typing import Any

ALIKE = 1e-9
"""Distances below are rounding."""


def findings(summary: Mapping[str, Any]) -> list[str]:
    """Sentences for somebody who has not read the paper.

    Parameters
    ----------
    summary : Mapping[str, Any]
        Of summary.json.

    Returns
    -------
    list[str]
        From what matters most to what matters least.
    """
    rows = list(summary["learners"].values())
    return [*_behaviour(summary, rows), *_constraints(rows), *_agreement(summary, len(rows)), *_delivery(summary)]


def _behaviour(summary: Mapping[str, Any], rows: list[Mapping[str, Any]]) -> Iterator[str]:
    watched = _span([row["iterations"] for row in rows], "d")
    if len(rows) == 1:
        yield f"The learner watched {watched} demonstrations."
    else:
        yield (
            f"Each of {len(rows)} learners watched {watched} demonstrations of its own. They exchanged parameters,"
            " nothing else, and these tell much of what was demonstrated."
        )
    if any(row["success_rate"] is None for row in rows):
        yield "Nobody knows the true constraints, so that no rates of success can be told."
    else:
        yield from _rates(rows)
    nats = [row["held_out_log_likelihood"] for row in rows if row["held_out_log_likelihood"] is not None]
    if nats and summary["expert_log_likelihood"] is not None:
        yield (
            f"Demonstrations that nobody learned from are predicted with {_span(nats, '.2f')} nats (log likelihood of"
            f" one; nearer 0 is better); by those who know the experts, with {summary['expert_log_likelihood']:.2f}."
        )


def _rates(rows: list[Mapping[str, Any]]) -> Iterator[str]:
    success = _span([100 * row["success_rate"] for row in rows], ".1f")
    broken = _span([100 * row["violation_rate"] for row in rows], ".1f")
    yield (
        f"Experts that act as was learned reach their goals and keep every true constraint in {success} % of trials; in"
        f" {broken} % they break one."
    )
    worst = min(row["success_late_minimum"] for row in rows)
    if worst < min(row["success_rate"] for row in rows) - 0.05:
        yield f"That was not always so: within the last 15 judged iterations success fell to {100 * worst:.1f} %."


def _constraints(rows: list[Mapping[str, Any]]) -> Iterator[str]:
    counts = _span([len(row["learned_constraints"]) for row in rows], "d")
    if any(row["false_discovery_rate"] is None for row in rows):
        yield f"{counts} constraints were found; nobody knows the true ones."
    else:
        wrong, unseen = (
            _span([100 * row[rate] for row in rows], ".1f") for rate in ("false_discovery_rate", "false_negative_rate")
        )
        yield (
            f"{counts} constraints were found, of which {wrong} % are wrong. {unseen} % of the true ones were not"
            " found: of things that experts would never come near anyway, demonstrations do not tell."
        )
    if any(row["undetermined"] for row in rows):
        undetermined = _span([row["undetermined"] or 0 for row in rows], "d")
        yield f"Of {undetermined} features the demonstrations cannot tell whether they are allowed or forbidden."


def _agreement(summary: Mapping[str, Any], count: int) -> Iterator[str]:
    if count < 2:
        return
    distances = summary["consensus_distance"]
    if max(distances["theta"], distances["omega"]) < ALIKE:
        yield "All learners ended with the same parameters."
    else:
        yield (
            f"What two learners would do differs in at most {100 * distances['policy']:.1f} % of the time (total"
            " variation)."
        )


def _delivery(summary: Mapping[str, Any]) -> Iterator[str]:
    delivered = summary.get("delivered_graph")
    if delivered is None:
        return
    late = delivered.get("late", len(delivered.get("edge_mismatches", ())))
    if late:
        yield f"In {delivered['iterations']} iterations the network differed from its schedule {late} times."
    else:
        yield f"The network delivered what the schedule asked for, in all {delivered['iterations']} iterations."


def _span(values: list[Any], form: str) -> str:
    """The values from the least to the largest, or the one that they all are when written."""
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"
