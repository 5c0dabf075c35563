"""The scaling benchmark: exponents by hand, its targets, and a small run."""

import os
from pathlib import Path
from statistics import median

import pytest
from bench_command import printed

from mabirds_bringup.bench.exchange.measure import peak_megabytes
from mabirds_bringup.bench.scale.cases import SMALL_SWEEPS, SWEEPS, Sweep, cells, experts, horizons
from mabirds_bringup.bench.scale.fit import exponent, targets, told
from mabirds_bringup.bench.scale.measure import solved
from mabirds_bringup.bench.solve.cases import SolveCase
from mabirds_bringup.bench.solve.measure import megabytes


def grown(power: float, sizes: tuple[int, ...] = (4, 16, 64)) -> dict[int, dict[str, float]]:
    """3 n^power milliseconds and n/16 megabytes."""
    return {size: {"milliseconds": 3.0 * size**power, "megabytes": size / 16} for size in sizes}


def test_exponents_are_those_of_power_laws_with_students_intervals() -> None:
    found = exponent([grown(1.5), grown(1.5)], "milliseconds")
    assert found is not None
    assert [found[key] for key in ("of_sizes", "mean", "half_width")] == pytest.approx([1.5, 1.5, 0.0], abs=1e-12)
    busy = grown(1.0)
    busy[64]["milliseconds"] *= 16.0  # other work, in one repetition
    apart = exponent([grown(1.0), busy], "milliseconds")
    assert apart is not None
    assert apart["of_sizes"] == pytest.approx(1.0)
    assert apart["mean"] == pytest.approx(1.5)
    between = exponent([grown(1.0), busy], "milliseconds", 0.0, median)
    assert between is not None
    assert 1.0 < (between["of_sizes"] or 0.0) < 2.0
    assert apart["half_width"] == pytest.approx(12.706 * 0.5, rel=1e-3)  # t of one degree of freedom


def test_memory_counts_where_it_can_be_seen() -> None:
    found = told([grown(1.0, (4, 16, 64, 256))])["exponents"]["megabytes"]
    assert found == {"of_sizes": pytest.approx(1.0), "mean": pytest.approx(1.0), "half_width": None}  # of 64 and 256
    assert told([grown(1.0)])["exponents"]["megabytes"] is None


def test_the_least_time_of_each_size_is_told_and_the_highest_rate() -> None:
    runs = [{2: {"milliseconds": ms, "rate": rate, "megabytes": 90.0}} for ms, rate in ((3.0, 50.0), (2.0, 70.0))]
    assert told(runs)["sizes"] == {"2": {"milliseconds": 2.0, "rate": 70.0, "megabytes": 90.0}}


@pytest.mark.parametrize(("power", "met"), [(2.0, True), (2.5, False)])
def test_targets(power: float, met: bool) -> None:
    results = {"cells": told([grown(power)]), "learners": told([grown(0.5)])}
    first, second = targets(results, (Sweep("cells", {}, 2.25),), 0.25)
    assert (first["value"], first["met"]) == (pytest.approx(power), met)
    assert (second["name"], second["met"]) == ("learners: exponent of time", False)


def test_sizes_are_those_of_the_games() -> None:
    for sweep in (*SWEEPS, *SMALL_SWEEPS):
        for size, case in sweep.cases.items():
            game = case.game
            of = {"cells": game.factors.n_cells, "horizon": game.horizon, "joint states": game.n_states}
            assert of[sweep.name] == size
    for make in (cells, horizons, experts):
        assert len(make((2, 3)).cases) == 2


def test_larger_games_take_more() -> None:
    little, much = solved(SolveCase(3, 2, 5)), solved(SolveCase(12, 2, 20))
    assert 0 < little["milliseconds"] < much["milliseconds"]
    assert much["megabytes"] >= 0


def test_the_most_memory_is_what_the_system_says() -> None:
    assert peak_megabytes(os.getpid()) == pytest.approx(1.024 * megabytes(), rel=0.2)


@pytest.mark.timeout(150)
def test_the_small_benchmark_runs(tmp_path: Path) -> None:
    """Of what a busy machine can say, only that small games are not above their laws."""
    content = printed(tmp_path, "scale", "--small", "--iterations", "30", "--repetitions", "2")
    met = {target["name"]: target["met"] for target in content["targets"]}
    assert set(met) == {f"{name}: exponent of time" for name in ("cells", "horizon", "joint states", "learners")}
    assert met["cells: exponent of time"]
    assert met["horizon: exponent of time"]
    assert set(content["results"]["learners"]["sizes"]) == {"2", "4"}
    for figures in content["results"]["learners"]["sizes"].values():
        assert figures["rate"] > 0
        assert 40 < figures["megabytes"] < 300
