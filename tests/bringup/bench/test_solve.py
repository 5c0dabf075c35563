"""The solving benchmark: its cases against each other, its targets, and the command."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from bench_command import printed

from mabirds_bringup.bench.solve.cases import CASES, ITERATIONS, SMALL, SolveCase, weights
from mabirds_bringup.bench.solve.measure import bandwidth_limit, fastest, reference, solve
from mabirds_bringup.bench.solve.peer import of_states, peer_solve
from mabirds_bringup.bench.solve.targets import targets
from mabirds_core.kernels.loading import library

TINY = SolveCase(3, 2, 5)


@pytest.mark.parametrize("case", [TINY, SolveCase(2, 3, 4), SolveCase(3, 1, 4)], ids=lambda case: case.name)
def test_the_reference_solves_the_same(case: SolveCase) -> None:
    asked = (case.game, *weights(case.game))
    for ours, theirs in zip(solve(*asked), reference(*asked), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


@pytest.mark.skipif(find_spec("imitation") is None, reason="the peer is not installed")
def test_the_peer_solves_the_same() -> None:
    game = TINY.game
    asked = (game, *of_states(game, *weights(game)))
    peer = peer_solve(*asked)
    assert peer is not None
    for ours, theirs in zip(solve(*asked), peer(), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


def test_weights_of_states_do_not_look_at_moves() -> None:
    game = TINY.game
    theta, omega = of_states(game, *weights(game))
    table = game.reward_features.table(theta) + game.cost_features.table(omega)
    np.testing.assert_allclose(table, table[:, :1] + np.zeros(game.n_actions), rtol=0, atol=1e-12)


def test_the_limit_grows_with_states_and_steps() -> None:
    assert bandwidth_limit(SolveCase(6, 2, 39).game) > 4 * bandwidth_limit(SolveCase(3, 2, 9).game) > 0


def test_the_fastest_counts_processor_time_of_at_least_three() -> None:
    done = list[int]()
    assert fastest(lambda: done.append(sum(range(10_000))), seconds=0.0) > 0
    assert len(done) == 3


def test_targets_are_limits_and_differences() -> None:
    case = SolveCase(3, 2, 5, {"milliseconds": 2.0})
    results = {
        case.name: {"milliseconds": 3.0, "megabytes": 9.0, "reference_difference": 1e-12},
        "iteration of ros_ws/config/patrol.yaml": {"milliseconds": 3.5},
    }
    found = {target["name"]: target["met"] for target in targets((case,), results)}
    assert found == {
        f"{case.name}: milliseconds": False,
        f"{case.name}: reference difference": True,
        "iteration of ros_ws/config/patrol.yaml: milliseconds": False,
    }


def test_every_limit_is_on_something_that_is_measured() -> None:
    measured = {"milliseconds", "megabytes", "times_of_bandwidth_limit", "share_of_reference"}
    for limits in (*(case.at_most for case in (*CASES, *SMALL)), *ITERATIONS.values()):
        assert set(limits) <= measured


@pytest.mark.skipif(library() is None, reason="kernels are not compiled")
def test_the_small_benchmark_meets_its_targets(tmp_path: Path) -> None:
    content = printed(tmp_path, "solve", "--small")
    assert content["machine"]["arithmetic"] == "fixed"
    assert len(content["results"]) == len(SMALL)
    assert all(target["met"] for target in content["targets"]), content["targets"]
