"""Rates of learned constraints by hand, and the AUC against all pairs and against the area under its curve."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.arrays import Mask, Vector
from mabirds_core.metrics.constraints import by_threshold, constraint_errors, ranking_auc


def test_a_constraint_is_learned_where_the_cost_exceeds_the_threshold() -> None:
    omega = np.array([-0.3, -0.2, -0.1, 0.0, 0.5])
    assert by_threshold(omega, 0.2).tolist() == [True, False, False, False, False]
    assert by_threshold(omega, 0.0).tolist() == [True, True, True, False, False]


def mask(*values: int) -> Mask:
    return np.array(values, dtype=bool)


def test_constraint_errors_by_hand() -> None:
    """Of three true constraints one is missed; of five harmless features two are taken for constraints."""
    errors = constraint_errors(mask(1, 1, 0, 1, 1, 0, 0, 0), mask(1, 1, 1, 0, 0, 0, 0, 0))
    assert errors.false_positive_rate == 2 / 5
    assert errors.false_negative_rate == 1 / 3
    assert errors.false_discovery_rate == 2 / 4


def test_error_rates_over_an_empty_class_are_zero() -> None:
    assert constraint_errors(mask(1, 0), mask(1, 1)) == (0.0, 0.5, 0.0)
    assert constraint_errors(mask(1, 0), mask(0, 0)) == (0.5, 0.0, 1.0)
    assert constraint_errors(mask(0, 0), mask(1, 0)) == (0.0, 1.0, 0.0)


SCORED = st.lists(st.tuples(st.sampled_from([-1.0, 0.0, 0.25, 0.5, 1.0]), st.booleans()), min_size=1, max_size=15)


def arrays(scored: list[tuple[float, bool]]) -> tuple[Vector, Mask]:
    scores, truth = zip(*scored, strict=True)
    return np.array(scores), np.array(truth)


@given(SCORED)
def test_auc_is_the_share_of_pairs_in_order(scored: list[tuple[float, bool]]) -> None:
    points = [
        1.0 if true > harmless else 0.5 if true == harmless else 0.0
        for true, is_true in scored
        for harmless, is_too in scored
        if is_true and not is_too
    ]
    assert ranking_auc(*arrays(scored)) == (pytest.approx(sum(points) / len(points)) if points else None)


@given(SCORED)
def test_auc_is_the_area_under_the_curve_of_all_thresholds(scored: list[tuple[float, bool]]) -> None:
    scores, truth = arrays(scored)
    auc = ranking_auc(scores, truth)
    if auc is None:
        assert truth.all() or not truth.any()
        return
    levels = [np.inf, *sorted(set(scores), reverse=True)]
    false_positive = [(scores >= level)[~truth].mean() for level in levels]
    true_positive = [(scores >= level)[truth].mean() for level in levels]
    assert auc == pytest.approx(np.trapezoid(true_positive, false_positive))


def test_auc_by_hand() -> None:
    assert ranking_auc(np.array([0.9, 0.1, 0.5]), mask(1, 0, 0)) == 1
    assert ranking_auc(np.array([0.5, 0.1, 0.5]), mask(1, 0, 0)) == 0.75
    assert ranking_auc(np.array([0.0, 0.1, 0.5]), mask(1, 0, 0)) == 0
