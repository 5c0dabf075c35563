"""Tables of reports: their cells worked out by hand."""

import polars as pl
from made_up import results

from mabirds_bringup.bench.summary import summarise
from mabirds_bringup.bench.tables import (
    NAME,
    TIMES,
    WORK,
    Column,
    Section,
    agreement_section,
    entries_section,
    number,
    rate,
    scaled,
    section,
)

COLUMNS = (NAME, rate("CVR", "violation_rate"), rate("SR", "success_rate"), rate("actor's SR", "actor_success_rate"))


def table(*made_up: pl.DataFrame) -> Section:
    return section("title", summarise(pl.concat(made_up)), (*COLUMNS, *TIMES, *WORK))


def lines_of(shown: Section) -> list[dict[str, str]]:
    return [dict(zip(shown.columns, line, strict=True)) for line in shown.lines]


def test_columns_that_no_row_has_are_left_out() -> None:
    rows = pl.DataFrame({"name": ["a", "b"], "seconds": [0.0, 3.0], "rate": [None, {"mean": 0.1, "half_width": 0.0}]})
    columns = (
        Column("", pl.col("name")),
        Column("time", scaled(pl.col("seconds")), number(".1f")),
        rate("rate", "rate"),
        rate("none", "absent"),
    )
    assert section("title", rows, columns) == Section(
        "title", ["", "time", "rate"], [["a", "0.0", ""], ["b", "1.0", "0.100 ± 0.000"]]
    )
    assert section("title", rows.head(1), columns).columns == ["", "time"]
    assert section("title", rows.clear(), columns).lines == []


def test_times_are_multiples_of_the_fastest_and_work_is_per_iteration() -> None:
    slow = results("FTL", "ftl", seconds=[2.0, 4.0], success_rate=[0.0, 0.4, 0.95], gradient_steps=20, policy_solves=22)
    first, second = lines_of(table(results(), slow))
    assert (first[""], second[""]) == ("MA-BIRDS learner_1", "FTL")
    assert (first["CVR"], first["SR"]) == ("0.010 ± 0.000", "0.980 ± 0.000")
    assert (first["STPOI"], second["STPOI"]) == ("1.000", "10.000")
    assert (first["50% ST"], second["50% ST"]) == ("1.000", "30.000")  # 0.2 s, 6 s
    assert (first["90% ST"], second["90% ST"]) == ("1.000", "10.000")
    assert (second["gradient steps"], second["policy solves"], second["seconds"]) == ("10.0", "11.0", "3.000")
    assert first["memory [MB]"] == "400"


def test_a_level_that_was_never_reached_took_for_ever() -> None:
    (line,) = lines_of(table(results("DLM", "dlm", success_rate=[0.0, 0.0, 0.0])))
    assert (line["50% ST"], line["90% ST"]) == ("never", "never")


def test_actors_have_columns_where_there_are_some() -> None:
    assert "actor's SR" not in table(results()).columns
    with_actor, without = lines_of(table(results(actor_success_rate=[0.1, 0.7]), results("BICS", "bics")))
    assert (with_actor["actor's SR"], without["actor's SR"]) == ("0.700 ± 0.000", "")


def test_the_table_of_agreement_is_of_learners_alone() -> None:
    (line,) = lines_of(agreement_section(summarise(pl.concat([results(), results("BICS", "bics")]))))
    assert line[""] == "MA-BIRDS learner_1 (main)"
    assert (line["SR, last update"], line["SR, end"]) == ("0.800 ± 0.000", "0.980 ± 0.000")
    assert (line["distance of theta"], line["of omega"], line["of policies"]) == ("1.0e-01", "2.0e-01", "0.050 ± 0.000")
    assert line["one constraint set"] == "1.000 ± 0.000"


def test_what_a_game_measures_has_a_line_for_each_thing() -> None:
    first = results(cost={"(3, 3) m": 2.0, "(1, 1) m": 1.0}, dearer={"(3, 3) m": 1.0, "(1, 1) m": 0.0})
    second = results(
        learner="learner_2", cost={"(3, 3) m": 4.0, "(1, 1) m": 1.0}, dearer={"(3, 3) m": 0.0, "(1, 1) m": 0.0}
    )
    shown = entries_section("Costs", pl.concat([first, second]), {"cost": "cost", "dearer": "dearer"})
    assert (shown.title, shown.columns) == ("Costs", ["", "cost", "dearer"])
    assert shown.lines == [
        ["(3, 3) m", "3.000 ± 1.000", "0.500 ± 0.500"],
        ["(1, 1) m", "1.000 ± 0.000", "0.000 ± 0.000"],
    ]
    assert entries_section("None", results().clear(), {"cost": "cost"}).lines == []
