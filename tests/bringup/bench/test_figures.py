"""Curves and thresholds against numbers worked out by hand."""

import matplotlib.pyplot as plt
import numpy as np
import polars as pl
import pytest
from made_up import results

from mabirds_bringup.bench.figures import RATES, THRESHOLDS, curves_figure, draw_band, error_curves
from mabirds_bringup.bench.frame import frame_of
from mabirds_bringup.bench.results import CaseResult, curve


def curves(*seeds: list[float], metric: str = "success_rate") -> pl.DataFrame:
    cases = (
        CaseResult("main", "MA-BIRDS", "learner_1", seed, [*curve(metric, values)]) for seed, values in enumerate(seeds)
    )
    return frame_of(cases)


def test_bands_are_means_and_ranges_by_iteration() -> None:
    figure, axis = plt.subplots()
    draw_band(axis, curves([0, 1], [1, 3]), "success_rate", "SR")
    draw_band(axis, curves([0, 1]), "no such metric", "none")
    (line,) = axis.lines
    assert (list(line.get_xdata()), list(line.get_ydata())) == ([0, 1], [0.5, 2.0])
    assert axis.collections[0].get_datalim(axis.transData).bounds == (0, 0, 1, 3)
    plt.close(figure)


def test_actors_are_dashed_and_of_the_colour_of_their_case() -> None:
    both = pl.concat([curves([0.1, 0.2]), curves([0.3], metric="actor_success_rate")])
    figure = curves_figure(both, RATES)
    parameters, actor = figure.axes[0].lines
    assert [line.get_label() for line in (parameters, actor)] == ["MA-BIRDS", "MA-BIRDS, actor"]
    assert (actor.get_linestyle(), actor.get_color()) == ("--", parameters.get_color())
    plt.close(figure)


def test_a_dotted_line_is_where_closing_rounds_begin() -> None:
    figure = curves_figure(results(), RATES)
    assert [list(line.get_xdata()) for line in figure.axes[0].lines if line.get_linestyle() == ":"] == [[2, 2]]
    plt.close(figure)


def test_error_curves_give_the_mean_rates_of_every_threshold() -> None:
    truth = np.array([True, True, True, False, False])
    omegas = np.array([[-0.1, -0.3, -5.0, 1.0, -0.2], [0.0, -1.0, -1.0, -1.0, 0.0]])
    made_up = pl.concat([results(seed=seed, omega=omega) for seed, omega in enumerate(omegas)])
    for threshold, false_positive, false_negative in zip(THRESHOLDS, *error_curves(truth, made_up), strict=True):
        learned = -omegas > threshold
        assert false_positive == pytest.approx(learned[:, ~truth].mean())
        assert false_negative == pytest.approx((~learned[:, truth]).mean())
