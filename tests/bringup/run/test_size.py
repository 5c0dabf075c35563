"""What is told before a run, against what is measured."""

import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from mabirds_bringup.bench.solve.cases import SolveCase, weights
from mabirds_bringup.bench.solve.solving import fastest, solve
from mabirds_bringup.run.size import Size, available_megabytes, estimate, size_of, told, warning
from mabirds_core.experiment.file import load_experiment

CASES = (SolveCase(8, 2, 30), SolveCase(20, 2, 20), SolveCase(5, 3, 30))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_seconds_are_within_a_factor_of_three(case: SolveCase) -> None:
    game = case.game
    work = partial(solve, game, *weights(game))
    work()
    ratio = estimate(game).seconds / (1e-3 * fastest(work, 0.3))
    assert 1 / 3 < ratio < 3


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_memory_is_what_a_solve_takes_and_at_most_twice_that(case: SolveCase) -> None:
    game = case.game
    given = weights(game)
    tracemalloc.start()
    solve(game, *given)
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    assert 0.9 < estimate(game).megabytes / peak < 2.0


def test_what_is_told(make_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(make_experiment(iterations=40))
    size = size_of(experiment)
    assert size is not None
    assert size.states == size.content["states"] > 1
    size = Size(10_000, 25, 30, 6.25, 0.004)
    assert told(size, experiment, 1) == (
        "10,000 states, 25 joint actions, horizon 30: about 4.0 ms and 6 MB for an iteration of a learner, 160.0 ms for"
        " 40 iterations"
    )


def test_who_does_not_fit_is_warned() -> None:
    size = Size(10**8, 25, 30, 74_400.0, 30.0)
    words = warning(size, 2, 16_000.0)
    assert words is not None
    assert words.startswith("149,020 MB are needed for 2 learning processes, 16,000 MB are free: take a smaller map")
    assert warning(size, 2, 200_000.0) is None
    assert warning(size, 2, None) is None


def test_the_system_says_what_is_free() -> None:
    available = available_megabytes()
    assert available is None or available > 10.0
