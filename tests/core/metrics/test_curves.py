"""What is said of curves, by hand and against the definitions spelled out."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.metrics.curves import LATE, first_at, late_mean, late_minimum, stays_from

CURVES = st.lists(st.sampled_from([0.0, 0.5, 0.9, 0.91, 1.0]), min_size=1, max_size=30)


def test_late_values_by_hand() -> None:
    rates = [0.0, *[1.0] * (LATE - 1), 0.4]
    assert late_minimum(rates) == 0.4
    assert late_mean(rates) == pytest.approx((LATE - 1 + 0.4) / LATE)
    assert late_minimum([0.5, 0.7]) == 0.5
    assert late_mean([0.5, 0.7]) == pytest.approx(0.6)


def test_a_bad_value_counts_as_late_until_enough_have_followed() -> None:
    assert late_minimum([0.0, *[1.0] * (LATE - 1)]) == 0
    assert late_minimum([0.0, *[1.0] * LATE]) == 1


@pytest.mark.parametrize(
    ("rates", "first", "stays"),
    [
        ([0.1, 0.95, 0.2, 0.91, 0.93], 1, 3),
        ([0.9, 0.9], 0, 0),
        ([0.9, 0.89], 0, None),
        ([0.1, 0.2], None, None),
        ([0.1, 0.9], 1, 1),
        ([], None, None),
    ],
)
def test_times_by_hand(rates: list[float], first: int | None, stays: int | None) -> None:
    assert (first_at(rates, 0.9), stays_from(rates, 0.9)) == (first, stays)


@given(CURVES)
def test_times_are_the_first_index_that_does(rates: list[float]) -> None:
    able = [k for k in range(len(rates)) if all(rate >= 0.9 for rate in rates[k:])]
    assert stays_from(rates, 0.9) == (min(able) if able else None)
    able = [k for k, rate in enumerate(rates) if rate >= 0.9]
    assert first_at(rates, 0.9) == (min(able) if able else None)
