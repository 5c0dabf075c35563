"""The exchange benchmark: its figures by hand, its targets, and a short run of learners and bare nodes."""

from pathlib import Path

import pytest
from bench_command import printed
from rclpy.serialization import serialize_message

from mabirds_bringup.bench.exchange.cases import CASES, LARGE, SMALL, ExchangeCase
from mabirds_bringup.bench.exchange.compare import ratios, targets
from mabirds_bringup.bench.exchange.measure import Reading, Watch, figures
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment


def run(processor: float, rate: float) -> dict[str, float]:
    return {"processor_milliseconds": processor, "rate": rate}


def test_ratios_are_medians_of_runs_that_followed_each_other() -> None:
    """The second round met a machine half as fast, which no ratio shows."""
    found = ratios(
        {
            "bare": [run(1.0, 400.0), run(2.0, 200.0), run(1.0, 400.0)],
            "learner": [run(1.5, 300.0), run(3.0, 150.0), run(9.0, 1.0)],
            "durable": [run(2.0, 250.0), run(4.0, 125.0), run(9.0, 1.0)],
        }
    )
    assert found == {
        "times_of_bare_processor_time": 1.5,
        "share_of_bare_rate": 0.75,
        "times_without_checkpoints": 1.2,
    }


@pytest.mark.parametrize(
    ("processor", "rate", "checkpoints", "met"),
    [(1.9, 0.6, 1.4, [True, True, True]), (2.1, 0.4, 1.6, [False, False, False])],
)
def test_targets(processor: float, rate: float, checkpoints: float, met: list[bool]) -> None:
    measured = {
        "times_of_bare_processor_time": processor,
        "times_without_checkpoints": checkpoints,
        "share_of_bare_rate": rate,
    }
    found = targets(CASES[:1], {CASES[0].name: measured})
    assert [target["met"] for target in found] == met
    assert [target["at_most"] for target in found] == [True, True, False]


def test_figures_by_hand() -> None:
    """Two learners, ten iterations of 10 ms from the third on, and 3 ms of each for an iteration."""
    from mabirds_msgs.msg import LearnerStatus

    experiment = Experiment.model_validate(ExchangeCase(2).settings(10))
    watch = Watch()
    for name in experiment.learners:
        watch.raw[name] = []
        for iteration in range(1, 12):
            status = LearnerStatus(iteration=iteration)
            status.stamp.nanosec = 10_000_000 * iteration
            watch.raw[name] += 2 * [serialize_message(status)]
    watch.readings = [Reading(n, 1.0 + 0.006 * n, 0.5 + 0.001 * n) for n in range(12)]
    watch.peak_megabytes = 93.0
    found = figures(watch, experiment)
    assert found == pytest.approx(
        {
            "rate": 100.0,
            "processor_milliseconds": 3.0,
            "p50": 10.0,
            "p99": 10.0,
            "statuses_an_iteration": 2.2,
            "peak_megabytes": 93.0,
            "processor_seconds": 1.066,
            "player_milliseconds": 1.0,
        }
    )


def test_long_parameters_are_as_long_as_is_said() -> None:
    for case, least in zip(LARGE, (1e4, 1e5), strict=True):
        experiment = Experiment.model_validate(case.settings(1))
        assert build_learner(experiment, "learner_1").initial_state().parameters.theta.size >= least


@pytest.mark.timeout(150)
def test_the_small_benchmark_runs(tmp_path: Path) -> None:
    """Without an opinion about its times: a machine that does much else says little about them."""
    content = printed(tmp_path, "exchange", "--small", "--iterations", "60")
    assert {target["name"] for target in content["targets"]} == {
        "2 learners: times of bare processor time",
        "2 learners: share of bare rate",
    }
    measured = content["results"][SMALL[0].name]
    assert measured["bare_statuses_an_iteration"] == pytest.approx(1, abs=0.1)
    assert 1 <= measured["learner_statuses_an_iteration"] < 2
    assert min(measured.values()) > 0
