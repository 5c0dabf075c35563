"""Verdicts of planners that took no part: against planning and following by hand, and only once for equal numbers."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.evaluate.evaluation import Evaluation, distance_to_experts, evaluate
from mabirds_bringup.evaluate.held_out import HeldOut, draw_held_out
from mabirds_bringup.evaluate.verdicts import ROLLOUTS, verdicts
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import build_game, build_reward, evaluation_policy
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import History
from mabirds_core.games.drones.demonstrated import log_ratios, straight_log_ratios
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.rollouts import drone_rollouts

JUDGES = ["hexagonal 0.125 m", "square 0.112 m", "hexagonal 0.094 m"]
"""Of drones that fly .25 m in a step."""

NOBODY = HeldOut(None, None)

Learned = tuple[Experiment, History, Evaluation]


@pytest.fixture(scope="module")
def learned(make_shared_drone_experiment: Callable[..., Path]) -> Learned:
    experiment = load_experiment(make_shared_drone_experiment(iterations=3))
    first = next(iter(simulate_from_bag(experiment).values()))
    history = dict.fromkeys(experiment.learners, first)  # who agree are judged once
    return experiment, history, evaluate(experiment, history, demonstrations_of(experiment))


def test_a_verdict_is_that_of_a_plan_made_by_hand(learned: Learned) -> None:
    experiment, history, evaluation = learned
    game, name = build_game(experiment), experiment.learners[0]
    found = evaluation.verdicts[name]
    assert list(found) == JUDGES
    temperature = experiment.algorithm.policy.temperature
    planner = LatticePlanner(game, build_reward(experiment, game), 0.25 / 5**0.5, temperature, "square", 1, draws=False)
    policy = planner.plan(*history[name][-1])
    verdict, (violation, success) = found["square 0.112 m"], game.judge.imitation(policy, experiment.seed, ROLLOUTS)
    assert (verdict.violation_rate, verdict.success_rate) == (violation, success)
    starts = game.starts(500, np.random.default_rng(experiment.seed))
    assert verdict.value == pytest.approx(policy.values(0, starts).mean())
    flights = drone_rollouts(game, policy, 50, np.random.default_rng(0))
    assert verdict.certificate == pytest.approx(0, abs=0.1)
    assert np.abs(policy.residuals(flights)).max() < 0.1
    shown = draw_held_out(experiment, game).demonstrations
    assert shown is not None
    assert verdict.held_out_log_likelihood == pytest.approx(log_ratios(policy, shown).mean())
    assert verdict.fixed_log_likelihood == pytest.approx(max(0.0, straight_log_ratios(policy, shown).mean()))


def test_without_rewards_no_start_is_worth_anything(learned: Learned) -> None:
    experiment, history, evaluation = learned
    name, at = experiment.learners[0], history[experiment.learners[0]][-1]
    nothing = Parameters(0 * at.theta, 0 * at.omega)
    found = verdicts(experiment, build_game(experiment), NOBODY, {name: nothing})[name]
    assert [verdict.value for verdict in found.values()] == pytest.approx([0.0] * 3, abs=1e-3)
    assert all(verdict.held_out_log_likelihood is verdict.fixed_log_likelihood is None for verdict in found.values())
    assert all(abs(verdict.value or 0.0) > 1e-2 for verdict in evaluation.verdicts[name].values())


def test_learners_that_agree_are_judged_once(learned: Learned, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment, history, evaluation = learned
    (name, other), at, plans = experiment.learners, history[experiment.learners[0]][-1], list[float]()
    assert evaluation.verdicts[name] is evaluation.verdicts[other]
    nothing = Parameters(0 * at.theta, 0 * at.omega)
    plan = LatticePlanner.plan

    def counted(planner: LatticePlanner, *_: object) -> object:
        plans.append(planner.spacing)
        return plan(planner, *nothing)

    monkeypatch.setattr(LatticePlanner, "plan", counted)
    verdicts(experiment, build_game(experiment), NOBODY, {name: at, other: at._replace(omega=at.omega + 1e-9)})
    assert len(plans) == 6


def test_games_without_a_lattice_have_no_judges(make_drone_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(make_drone_experiment("soft_actor_critic", iterations=2))
    settings = experiment.game.model_copy(update={"dynamics": "double_integrator"})
    game = build_game(experiment.model_copy(update={"game": settings}))
    assert game.judging_planners(experiment.algorithm.policy, game.linear_reward()) == {}


def test_what_drones_learned_is_held_against_what_takes_no_learning(learned: Learned) -> None:
    """Flights of the policy itself are likely, and go where its rollouts go; those of another one do neither."""
    experiment, history, _ = learned
    game, name = build_game(experiment), experiment.learners[0]
    policy = evaluation_policy(experiment, name, game)(history[name][-1])
    own = HeldOut(None, drone_rollouts(game, policy, 100, np.random.default_rng(0)))
    fixed = own.fixed_log_likelihoods(game, policy)
    assert set(fixed) == {"uniform", "straight flight"}
    assert fixed["uniform"] == 0.0 < (own.log_likelihood(game, policy) or 0.0)
    near, far = (
        distance_to_experts(experiment, game, evaluation_policy(experiment, name, game)(at), own)
        for at in (history[name][-1], history[name][0])
    )
    assert 0 < (near or 0.0) < (far or 0.0) < 1
    assert NOBODY.fixed_log_likelihoods(game, policy) == {}
    assert distance_to_experts(experiment, game, policy, NOBODY) is None
