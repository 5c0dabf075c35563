"""Limits by label and group."""

import polars as pl

from mabirds_bringup.bench.study import TargetSettings
from mabirds_bringup.bench.tables import section
from mabirds_bringup.bench.targets import COLUMNS, SCHEMA, targets_of

ROWS = pl.DataFrame(
    {
        "group": ["main", "main", "main", "hard"],
        "label": ["FTL", "DLM", "BICS", "FTL"],
        "name": ["FTL", "DLM", "BICS", "FTL"],
        "rate": [
            {"mean": 0.2, "half_width": 0.1},
            None,
            {"mean": 0.9, "half_width": 0.0},
            {"mean": 0.9, "half_width": 0.0},
        ],
        "success": [0.5, 0.5, 0.5, 0.5],
    }
)


def targets(**settings: object) -> pl.DataFrame:
    return targets_of(TargetSettings.model_validate({"groups": ("main",), **settings}), ROWS)


def test_limits_are_for_the_labels_and_rows_that_have_them() -> None:
    found = pl.concat(
        [targets(measure="rate", at_most={"FTL": 0.1, "DLM": 0.1}), targets(measure="success", at_least={"FTL": 0.5})]
    )
    assert found.rows(named=True) == [
        {"name": "main: FTL rate", "value": 0.2, "target": 0.1, "at_most": True, "met": False},
        {"name": "main: FTL success", "value": 0.5, "target": 0.5, "at_most": False, "met": True},
    ]
    assert section("Targets", found, COLUMNS).lines == [
        ["main: FTL rate", "0.200", "<= 0.1", "missed"],
        ["main: FTL success", "0.500", ">= 0.5", "met"],
    ]


def test_a_measure_may_have_limits_on_both_sides_and_in_several_groups() -> None:
    found = targets(measure="success", groups=("main", "hard"), at_most={"FTL": 0.4}, at_least={"FTL": 0.4})
    assert found["met"].to_list() == [False, False, True, True]


def test_a_measure_that_no_row_has_gives_no_target() -> None:
    assert targets(measure="absent", at_most={"FTL": 1.0}).schema == SCHEMA
    assert targets(measure="success", groups=("none",), at_most={"FTL": 1.0}).is_empty()
