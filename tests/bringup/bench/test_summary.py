"""Rows over seeds against numbers worked out by hand."""

import polars as pl
import pytest
from made_up import results

from mabirds_bringup.bench.frame import LEARNER
from mabirds_bringup.bench.summary import mean_of_all, mean_range, summarise, time_to, time_to_stay


def test_a_mean_range_is_the_mean_and_half_of_the_range() -> None:
    cell = pl.DataFrame({"rate": [0.1, 0.2, 0.6]}).select(mean_range(pl.col("rate"))).item()
    assert cell == pytest.approx({"mean": 0.3, "half_width": 0.25})
    assert pl.DataFrame({"rate": [None]}).select(mean_range(pl.col("rate").cast(pl.Float64))).item() is None


def test_a_mean_of_all_needs_all() -> None:
    frame = pl.DataFrame({"known": [1.0, 2.0], "unknown": [1.0, None]})
    means = frame.select(mean_of_all(pl.col("known")).alias("known"), mean_of_all(pl.col("unknown")).alias("unknown"))
    assert means.row(0) == (1.5, None)


@pytest.mark.parametrize(("level", "time"), [(0.5, 0.2), (0.8, 0.6), (0.0, 0.0), (1.1, None)])
def test_the_time_to_a_level_adds_the_updates_before_it(level: float, time: float | None) -> None:
    (seconds,) = results().group_by(*LEARNER, "seed").agg(time=time_to(level))["time"].to_list()
    assert seconds == (None if time is None else pytest.approx(time))


@pytest.mark.parametrize(("level", "time"), [(0.5, 0.6), (0.3, 0.6), (0.0, 0.0), (0.98, 0.6), (1.1, None)])
def test_the_time_until_a_level_is_kept_adds_the_updates_before_it(level: float, time: float | None) -> None:
    """Once is not enough: .5 and .3 are lost again."""
    swings = results(success_rate=[0.0, 0.9, 0.2, 0.98])
    (seconds,) = swings.group_by(*LEARNER, "seed").agg(time=time_to_stay(level))["time"].to_list()
    assert seconds == (None if time is None else pytest.approx(time))


def test_a_row_holds_means_over_seeds_before_and_after_the_closing_rounds() -> None:
    other = results(seed=2, violation_rate=[1.0, 1.0, 0.08, 0.03], seconds=[0.3, 0.3], peak_memory=500.0)
    (row,) = summarise(pl.concat([results(), other])).to_dicts()
    assert row["name"] == "MA-BIRDS learner_1"
    assert row["violation_rate"] == pytest.approx({"mean": 0.02, "half_width": 0.01})
    assert (row["updated_violation_rate"]["mean"], row["updated_success_rate"]["mean"]) == pytest.approx((0.06, 0.8))
    assert row["success_rate"]["mean"] == pytest.approx(0.98)
    assert row["iteration_seconds"] == pytest.approx(0.3)
    assert row["seconds_to_level"] == row["seconds_to_stay"] == pytest.approx([0.25, 0.6])
    assert [row[of] for of in ("iterations", "gradient_steps", "policy_solves", "peak_memory")] == [2, 2, 4, 450]
    assert (row["consensus_theta"]["mean"], row["consensus_omega"]["mean"]) == pytest.approx((0.1, 0.2))


def test_what_things_measure_is_averaged_and_parameters_are_not() -> None:
    (row,) = summarise(results(dearer={"a": 1.0, "b": 0.0}, theta=[5.0])).to_dicts()
    assert row["dearer"]["mean"] == 0.5
    assert not {"omega", "theta"} & row.keys()


def test_a_metric_that_some_rows_lack_is_null_there() -> None:
    rows = summarise(pl.concat([results(actor_success_rate=[0.1, 0.7]), results("BICS", "bics")])).to_dicts()
    assert [row["actor_success_rate"] for row in rows] == [{"mean": 0.7, "half_width": 0.0}, None]


def test_seconds_are_compared_with_the_fastest_learner_of_the_group() -> None:
    quick_method = results("BICS", "bics", seconds=[0.1, 0.1])
    elsewhere = results(group="other", seconds=[5.0, 5.0])
    rows = summarise(pl.concat([results(), results(learner="learner_2", seconds=[0.6, 0.6]), quick_method, elsewhere]))
    assert rows["seconds_ratio"].to_list() == pytest.approx([1.0, 2.0, 1 / 3, 1.0])
