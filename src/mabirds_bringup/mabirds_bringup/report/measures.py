"""What each number of a report means, for somebody who has not read the paper: one place, for all reports."""

from typing import NamedTuple


class Measure(NamedTuple):
    """A number of ``summary.json``.

    Attributes
    ----------
    key : str
        Its name there.
    title : str
        As a column.
    form : str
        How it is written.
    meaning : str
        In words.
    better : str
        Which values are good.
    """

    key: str
    title: str
    form: str
    meaning: str
    better: str


MEASURES = (
    Measure(
        "success_rate",
        "SR",
        ".3f",
        "Success rate: how often experts that act as learned all arrive in time and break no true constraint.",
        "1 is perfect",
    ),
    Measure(
        "violation_rate",
        "CVR",
        ".3f",
        "Constraint violation rate: how often they break a true constraint at some step.",
        "0 is perfect",
    ),
    Measure(
        "success_late_minimum",
        "SR, least of the last 15",
        ".3f",
        "The worst success rate among the last 15 judged iterations: whether what was learned also stays.",
        "near SR is good",
    ),
    Measure(
        "held_out_log_likelihood",
        "held-out nats",
        ".2f",
        "How likely what was learned makes demonstrations that nobody learned from: mean log probability of one, in"
        " nats. One nat less is 2.7 times less likely.",
        "near the experts' own value is good",
    ),
    Measure(
        "occupancy_distance",
        "occupancy distance",
        ".3f",
        "By how much the places and actions differ in which experts spend their time, as learned and in truth"
        " (total variation).",
        "0 is the same, 1 is nothing in common",
    ),
    Measure(
        "false_discovery_rate",
        "FDR",
        ".3f",
        "Share of the learned constraints that are none in truth.",
        "0 is perfect",
    ),
    Measure(
        "false_positive_rate",
        "FPR",
        ".3f",
        "Share of all harmless features that were taken for constraints.",
        "0 is perfect",
    ),
    Measure(
        "false_negative_rate",
        "FNR",
        ".3f",
        "Share of the true constraints that were not found. Of some no demonstration can tell: going round them costs"
        " nothing.",
        "0 is perfect, and seldom possible",
    ),
    Measure(
        "auc",
        "AUC",
        ".3f",
        "How well their order tells true constraints from harmless features: the chance that a true one is ranked"
        " before a harmless one.",
        "1 is perfect, 0.5 is chance",
    ),
)


def shown(value: float | None, form: str) -> str:
    """A number as it is written; nothing where there is none."""
    return "" if value is None else format(value, form)
