"""The one table of results, and how it is kept."""

from pathlib import Path

import numpy as np
import pytest

from mabirds_bringup.bench.frame import SCHEMA, array_of, frame_of, is_learner, name, read_results, write_results
from mabirds_bringup.bench.results import CaseResult, MetricsRow, curve, entries


def result(*rows: MetricsRow, learner: str = "learner_1", seed: int = 1) -> CaseResult:
    return CaseResult("main", "MA-BIRDS", learner, seed, list(rows))


def test_every_number_is_a_row_in_order() -> None:
    made_up = result(*curve("success_rate", [0.0, 0.5]), *curve("seconds", [2.0], first=1), *entries(1, work=[[3, 4]]))
    frame = frame_of([made_up, result(MetricsRow(0, "success_rate", 1.0), seed=2)])
    assert frame.schema == SCHEMA
    assert frame.select("seed", "iteration", "metric", "value").rows() == [
        (1, 0, "success_rate", 0.0),
        (1, 1, "success_rate", 0.5),
        (1, 1, "seconds", 2.0),
        (1, 1, "work[0,0]", 3.0),
        (1, 1, "work[0,1]", 4.0),
        (2, 0, "success_rate", 1.0),
    ]
    assert frame_of([]).schema == SCHEMA


@pytest.mark.parametrize("shape", [(1,), (12,), (3, 4), (2, 11, 1, 2)])
def test_an_array_comes_back_in_its_shape(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(1).normal(size=shape)
    frame = frame_of([result(*entries(3, omega=values, omega_of_others=[7.0]))])
    np.testing.assert_array_equal(array_of(frame, "omega"), values)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    assert read_results(tmp_path).equals(frame_of([]))
    frame = frame_of([result(*curve("success_rate", [0.1, 1 / 3]))])
    write_results(tmp_path, frame)
    assert read_results(tmp_path).equals(frame)


def test_the_name_tells_learners_of_a_case_apart() -> None:
    frame = frame_of([result(MetricsRow(0, "seconds", 1.0), learner=learner) for learner in ("learner_2", "bics")])
    assert frame.select(name())["name"].to_list() == ["MA-BIRDS learner_2", "MA-BIRDS"]


def test_what_things_cost_are_rows_by_their_names() -> None:
    frame = frame_of([result(*entries(2, cost={"(3, 3) m, drone 1": 0.5, "door": 1.0}))])
    assert frame.select("metric", "value").rows() == [("cost[(3, 3) m, drone 1]", 0.5), ("cost[door]", 1.0)]


def test_an_array_that_has_no_entries_is_empty() -> None:
    assert array_of(frame_of([result(*entries(1, theta=np.zeros(0)))]), "theta").shape == (0,)


def test_learners_are_those_that_are_no_methods_whatever_they_are_called() -> None:
    frame = frame_of([result(MetricsRow(0, "seconds", 1.0), learner=learner) for learner in ("north", "ftl")])
    assert frame.filter(is_learner())["learner"].to_list() == ["north"]
    assert frame.select(name())["name"].to_list() == ["MA-BIRDS north", "MA-BIRDS"]
