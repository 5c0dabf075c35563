"""The theory benchmark: slopes against known ones, the network against ``simulate``, identities, and the command."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from bench_command import printed
from games import central_differences

from mabirds_bringup.bench.frame import frame_of
from mabirds_bringup.bench.results import CaseResult, curve
from mabirds_bringup.bench.theory.cases import BASE, CASES, LONGER, N_LEARNERS, SCHEDULES, SETTINGS, STEP, TheoryCase
from mabirds_bringup.bench.theory.claims import TOLERANCE, targets
from mabirds_bringup.bench.theory.exponents import exponents, key
from mabirds_bringup.bench.theory.inner import dual, inner_optimum
from mabirds_bringup.bench.theory.measure import demonstration_variance, measure, policy_iterations
from mabirds_bringup.bench.theory.network import OMEGA_BOUND, WEIGHT, iterates
from mabirds_bringup.bench.theory.problem import COST, Problem
from mabirds_bringup.bench.theory.report import by_key
from mabirds_bringup.bench.theory.slopes import bin_means, bins, interval, slope
from mabirds_core.consensus.assumptions import connectivity_window
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.interface import discounted_visitation

HARD = TheoryCase("test", "hard", hard=True)
BOUNDED = TheoryCase("test", "bounded", step=40.0, hard=True, omega="bounded")
REGULARISED = TheoryCase("test", "regularised", hard=True, omega="regularised")


@pytest.mark.parametrize("exponent", [-1.4, -0.9, -0.55, 0.3, 1.0])
def test_power_laws_have_their_exponent(exponent: float) -> None:
    means = bin_means(3.0 * np.arange(1.0, 1501) ** exponent)
    late = {n: mean for n, mean in means.items() if n >= 30}
    assert slope(np.array(list(late)), np.array(list(late.values()))) == pytest.approx(exponent, abs=0.01)


def test_a_slope_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    x, y = np.exp(rng.normal(size=20)), np.exp(rng.normal(size=20))
    assert slope(x, y) == pytest.approx(np.polyfit(np.log(x), np.log(y), 1)[0], abs=1e-12)


def test_bins_hold_every_iteration_once_and_decades_end_bins() -> None:
    of = bins(1500)
    np.testing.assert_array_equal(np.concatenate(of), np.arange(1, 1501))
    assert {1, 10, 100, 1000, 1500} <= {int(numbers[-1]) for numbers in of}
    widths = [numbers[-1] / (numbers[0] - 1) for numbers in of[-8:-1]]
    assert widths == pytest.approx([10**0.1] * 7, rel=0.03)


def test_means_of_bins_leave_out_what_was_not_measured() -> None:
    assert bin_means(np.array([2.0, np.nan, 4.0]), 1) == {1: 2.0, 3: 4.0}


def test_intervals_by_hand_and_by_coverage() -> None:
    by_hand = interval([1.0, 3.0])
    assert by_hand.mean == 2
    assert by_hand.half_width == pytest.approx(12.7062, abs=1e-4)  # Student, one degree of freedom, times 1
    rng = np.random.default_rng(2)
    intervals = [interval(list(rng.normal(size=5))) for _ in range(400)]
    assert 0.92 <= np.mean([abs(of.mean) <= of.half_width for of in intervals]) <= 0.98


def test_slopes_with_noise_lie_within_their_interval() -> None:
    """Eight seeds of n^-0.75 with lognormal noise, made up."""
    rng, n = np.random.default_rng(3), np.arange(1.0, 1501)
    slopes = []
    for _ in range(8):
        noisy = bin_means(n**-0.75 * np.exp(0.3 * rng.normal(size=len(n))))
        means = {last: mean for last, mean in noisy.items() if last >= 30}
        slopes.append(slope(np.array(list(means)), np.array(list(means.values()))))
    found = interval(slopes)
    assert abs(found.mean + 0.75) <= 2 * found.half_width
    assert found.half_width <= 0.05


@pytest.mark.parametrize("case", [BASE, CASES[-1]], ids=["paper", "default"])
def test_the_network_is_that_of_simulate(case: TheoryCase) -> None:
    problem = Problem(case, 6, 4)
    history = simulate(problem.experiment, problem.streams())
    for n, network in enumerate(iterates(problem)):
        for learner, (name, parameters) in zip(network, history.items(), strict=True):
            for own, other in zip(learner.parameters, parameters[n], strict=True):
                np.testing.assert_array_equal(own, other, err_msg=name)


def test_the_true_theta_is_the_experts_reward() -> None:
    problem = Problem(BASE, 1, 0)
    table = problem.game.reward_features.table(problem.true_theta)
    np.testing.assert_allclose(table, problem.game.task_reward, rtol=0, atol=1e-12)


def test_soft_experts_are_at_the_inner_optimum_of_their_own_costs() -> None:
    problem = Problem(BASE, 1, 0)
    omega = np.where(problem.game.true_constraints, -COST, 0.0)
    np.testing.assert_allclose(dual(problem, omega)[1], 0, rtol=0, atol=1e-12)
    assert (problem.budget[problem.game.true_constraints] > 0).all()
    assert not Problem(HARD, 1, 0).budget[problem.game.true_constraints].any()


@pytest.mark.parametrize("case", [BASE, HARD, REGULARISED], ids=lambda case: case.label)
def test_the_dual_has_its_gradient(case: TheoryCase) -> None:
    problem = Problem(case, 1, 0)
    omega = np.random.default_rng(5).normal(size=len(problem.budget))
    gradient = central_differences(lambda at: dual(problem, at)[0], omega)
    np.testing.assert_allclose(dual(problem, omega)[1], gradient, rtol=0, atol=1e-7)


def test_only_hard_constraints_have_no_inner_optimum() -> None:
    """A tenth of the tolerance: a larger omega where b = 0, the same one elsewhere."""
    soft, hard, regularised = (
        [inner_optimum(Problem(case, 1, 0), tolerance).largest_cost for tolerance in (1e-3, 1e-4)]
        for case in (BASE, HARD, REGULARISED)
    )
    assert hard[1] > hard[0] + 1
    assert soft == pytest.approx([COST, COST], abs=0.05)
    assert regularised[0] == pytest.approx(regularised[1], abs=0.05)


@pytest.mark.parametrize("schedule", SCHEDULES.values(), ids=SCHEDULES)
def test_mixing_keeps_the_mean_and_each_parameter_has_its_step(schedule: dict[str, Any]) -> None:
    """mean omega(n+1) = mean omega(n) - alpha(n) mean gradient: violations telescope over omega / alpha."""
    problem = Problem(TheoryCase("test", "schedule", SETTINGS[0], schedule=schedule), 8, 1)
    network = list(iterates(problem))
    for n, (now, after) in enumerate(pairwise(network), 1):
        for name, eta in (("omega", SETTINGS[0].eta1), ("theta", SETTINGS[0].eta2)):
            gradient = np.mean([getattr(learner.estimate.gradient, name) for learner in now], axis=0)
            moved = _mean(after, name) - _mean(now, name)
            np.testing.assert_allclose(moved, -STEP / n**eta * gradient, rtol=0, atol=1e-12)


def _mean(network: list[Any], name: str) -> Any:
    return np.mean([getattr(learner.parameters, name) for learner in network], axis=0)


def test_a_bounded_omega_stays_in_its_box_and_theta_is_free() -> None:
    *_, last = iterates(Problem(BOUNDED, 5, 1))
    assert np.abs(last[0].parameters.omega).max() == OMEGA_BOUND
    assert np.abs(last[0].parameters.theta).max() > OMEGA_BOUND


def test_the_weight_pulls_omega_and_leaves_what_the_policy_does() -> None:
    """Until a step is taken both are alike; then the gradient differs by WEIGHT omega."""
    free = list(iterates(Problem(HARD, 2, 1)))
    regularised = list(iterates(Problem(REGULARISED, 2, 1)))
    second, pulled = free[1][0], regularised[1][0]
    np.testing.assert_array_equal(second.parameters.omega, pulled.parameters.omega)
    np.testing.assert_array_equal(second.estimate.imagined.omega, pulled.estimate.imagined.omega)
    difference = pulled.estimate.gradient.omega - second.estimate.gradient.omega
    np.testing.assert_allclose(difference, WEIGHT * second.parameters.omega, rtol=0, atol=1e-12)


def test_schedules_differ_in_their_window_b() -> None:
    windows = {name: connectivity_window(_experiment(schedule).edge_schedule) for name, schedule in SCHEDULES.items()}
    assert windows == {"complete": 1, "alternating pairs": 2, "a pair at a time": 3, "a pair, then three pauses": 12}
    assert STEP < 1 / N_LEARNERS


def _experiment(schedule: Any) -> Any:
    return Problem(TheoryCase("test", "schedule", schedule=schedule), 1, 0).experiment


def test_quantities_of_the_first_iterations_by_hand() -> None:
    """At first every policy is uniform and all learners agree."""
    rows = {(n, name): value for n, name, value in measure(BASE, 3, 1).rows}
    assert rows[1, "theta"] == rows[1, "omega"] == rows[1, "policy"] == rows[1, "largest_cost"] == 0
    assert rows[2, "theta"] > 0
    problem = Problem(BASE, 3, 1)
    first, second, _ = iterates(problem)
    uniform, constraints = first[0].estimate.imagined, problem.game.true_constraints
    violation = (uniform.omega - problem.budget)[constraints].sum()
    assert rows[1, "violation"] == pytest.approx(violation)
    assert rows[1, "reward_gap"] == pytest.approx(abs(problem.true_theta @ (uniform.theta - problem.expert_features)))
    gradients = [np.mean([of.estimate.gradient.theta for of in network], axis=0) for network in (first, second)]
    assert rows[2, "regret"] == pytest.approx(np.mean([gradient @ gradient for gradient in gradients]))
    assert rows[1, "population"] == pytest.approx(((uniform.theta - problem.expert_features) ** 2).sum())


def test_hard_constraints_are_learned_longer() -> None:
    hard = next(case for case in CASES if case.group == "hard")
    assert max(row.iteration for row in measure(hard, 4, 1).rows) == 4 * LONGER


def test_the_floor_is_the_variance_of_the_demonstrations() -> None:
    problem = Problem(BASE, 5, 1)
    features = problem.game.reward_features
    totals = np.array(
        [
            features.total(discounted_visitation(trajectory, problem.game.discount))
            for stream in problem.streams().values()
            for trajectory in stream
        ]
    )
    distances = ((totals[:, None] - totals) ** 2).sum()  # over all pairs: 2 m^2 times the variance with divisor m
    assert demonstration_variance(problem) == pytest.approx(distances / (2 * 20 * 19))


def test_policies_are_compared_at_the_end_of_every_bin() -> None:
    compared = policy_iterations(1500)
    assert {int(numbers[-1]) for numbers in bins(1500)} <= compared
    assert len(compared) < 250


def made_up(case: TheoryCase, seed: int, **changes: float) -> CaseResult:
    """Power laws with the exponents that the update implies, at N = 1000."""
    eta1, eta2 = case.etas or SETTINGS[1]
    laws = {
        "theta": -eta2,
        "omega": -eta1,
        "policy": -0.5,
        "violation": eta1,
        "reward_gap": -0.4,
        "regret": 0.0,
        "population": -0.6,
        "largest_cost": 0.1,
        **changes,
    }
    n = np.arange(1.0, 1001)
    wiggle = 1e-6 * seed
    rows = [row for name, exponent in laws.items() for row in curve(name, list(n ** (exponent + wiggle)), first=1)]
    return CaseResult(case.group, case.label, "network", seed, [*rows, *curve("floor", [1.0], first=1000)])


def rows_of(**changes: float) -> pl.DataFrame:
    return exponents(frame_of([made_up(case, seed, **changes) for case in CASES for seed in (1, 2)]), by_key())


def test_exponents_of_made_up_cases() -> None:
    rows = {key(row["group"], row["label"]): row for row in rows_of().to_dicts()}
    base = rows[key(BASE.group, BASE.label)]
    assert base["theta"]["mean"] == pytest.approx(-0.75, abs=1e-4)
    assert base["theta"]["half_width"] == pytest.approx(12.7062 * 0.5e-6, rel=1e-3)
    assert base["seeds"] == 2
    assert base["violation_end"] == pytest.approx(1000**0.75, rel=1e-4)
    assert base["violation_tenth"] == pytest.approx(100**0.75, rel=1e-4)


def test_a_sum_that_changes_its_sign_has_no_exponent() -> None:
    result = made_up(BASE, 1)
    rows = [row._replace(value=-row.value) if row.metric == "violation" else row for row in result.rows]
    turned = frame_of([CaseResult(BASE.group, BASE.label, "network", seed, rows) for seed in (1, 2)])
    assert exponents(turned, by_key())["violation"].to_list() == [None]


def test_targets_are_met_by_what_the_update_implies_and_missed_by_what_is_printed() -> None:
    assert targets(rows_of())["met"].all()
    missed = targets(rows_of(theta=-0.75)).remove(pl.col("met"))
    assert missed["name"].to_list() == [
        "theta at (0.55, 0.9): distance of the exponent from -0.9",
        "theta at (0.9, 0.55): distance of the exponent from -0.55",
    ]
    assert missed["value"].to_list() == pytest.approx([0.15, 0.2], abs=1e-3)
    assert missed["target"].unique().to_list() == [TOLERANCE]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The command with two seeds and few iterations: its directory, and what it printed."""
    cwd = tmp_path_factory.mktemp("theory")
    return cwd / "out", printed(cwd, "theory", *["--seeds", "2", "--iterations", "20", "--out", "out"])


def test_the_command_writes_a_report(report: tuple[Path, dict[str, Any]]) -> None:
    directory, content = report
    pictures = {"consensus.png", "sums.png", "networks.png", "hard.png"}
    files = {"results.parquet", "summary.json", "report.md", "report.html"}
    assert {file.name for file in directory.iterdir()} == pictures | files
    assert content == json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    assert content["seeds"] == [301, 302]
    assert len(content["results"]) == len(CASES)
    text = (directory / "report.md").read_text(encoding="utf-8")
    for target in content["targets"]:
        assert f"| {target['name']} |" in text
    for case in CASES:
        assert f"| {case.label} |" in text
    assert all(picture in (directory / "report.html").read_text(encoding="utf-8") for picture in pictures)


def test_the_command_is_reproducible(report: tuple[Path, dict[str, Any]]) -> None:
    results = pl.read_parquet(report[0] / "results.parquet").filter(group=BASE.group, label=BASE.label, seed=302)
    again = frame_of([measure(BASE, 20, 302)])
    assert results.equals(again)
