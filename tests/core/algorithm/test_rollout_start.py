"""Rolling out from the demonstrations' starts: the same mean as from P_0, with less variance."""

from dataclasses import replace

import numpy as np
from experiments import demonstrations, experiment
from games import all_trajectories, hallway, probabilities, random_policy

from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import build_game, build_learner
from mabirds_core.games.interface import Trajectories, discounted_visitation
from mabirds_core.planners.occupancy import ExactOccupancy, SampledOccupancy, rollouts


def test_rollouts_begin_at_the_given_starts_equally_often() -> None:
    game, starts = hallway(), np.array([3, 3, 8, 20])
    policy = random_policy(game, np.random.default_rng(0))
    drawn = rollouts(game, policy, 4000, np.random.default_rng(1), starts).states[:, 0]
    shares = [float((drawn == start).mean()) for start in (3, 8, 20)]
    np.testing.assert_allclose(shares, [0.5, 0.25, 0.25], atol=0.03)


def test_the_exact_expectation_from_a_start_is_that_of_all_trajectories_from_it() -> None:
    game = hallway()
    policy, start = random_policy(game, np.random.default_rng(0)), int(np.flatnonzero(game.initial_distribution)[1])
    everything = all_trajectories(game)
    here = everything.states[:, 0] == start
    chances = probabilities(game, policy, everything)[here] / game.initial_distribution[start]
    expected = sum(
        chance
        * game.cost_features.total(discounted_visitation(Trajectories(states[None], actions[None]), game.discount))
        for states, actions, chance in zip(everything.states[here], everything.actions[here], chances, strict=True)
    )
    exact = ExactOccupancy(game)(policy, np.random.default_rng(), np.array([start]))
    np.testing.assert_allclose(game.cost_features.total(exact), expected, atol=1e-12)


def test_averaged_over_p0_both_kinds_of_start_give_the_same_expectation() -> None:
    game = hallway()
    policy, rng = random_policy(game, np.random.default_rng(0)), np.random.default_rng(0)
    expectation = ExactOccupancy(game)
    by_start = sum(
        game.initial_distribution[start] * game.cost_features.total(expectation(policy, rng, np.array([start])))
        for start in np.flatnonzero(game.initial_distribution)
    )
    np.testing.assert_allclose(game.cost_features.total(expectation(policy, rng)), by_start, atol=1e-12)


def test_the_difference_to_a_demonstration_varies_less_from_its_own_start() -> None:
    game = hallway()
    policy, rng = random_policy(game, np.random.default_rng(0)), np.random.default_rng(1)
    expectation, spread = SampledOccupancy(game, 20), {}
    seen = rollouts(game, policy, 300, rng)
    for own in (False, True):
        differences = [
            game.cost_features.total(expectation(policy, rng, states[:1] if own else None))
            - game.cost_features.total(discounted_visitation(Trajectories(states[None], actions[None]), game.discount))
            for states, actions in zip(*seen, strict=True)
        ]
        spread[own] = float(np.var(differences, axis=0).sum())
    assert spread[True] < 0.8 * spread[False]


def test_a_learner_rolls_out_from_the_starts_of_its_window() -> None:
    starts = [[[0, 0], [0, 2]], [[1, 0], [0, 1]]]
    changes = {
        "algorithm.rollout_start": "demonstration",
        "algorithm.window": 2,
        "algorithm.expectation": "exact",
        "game.starts": starts,
    }
    settings = experiment(changes)
    game, learner = build_game(settings), build_learner(settings, "ann")
    first, second = demonstrations(settings)["ann"][:2]
    state = learner.step(learner.initial_state(), first, others(learner.initial_state().parameters)).state
    found = learner.step(state, second, others(state.parameters)).gradient
    policy = learner.estimator.planner.plan(*state.parameters)
    own_starts = np.array([first.states[0, 0], second.states[0, 0]])
    imagined = ExactOccupancy(game)(policy, np.random.default_rng(), own_starts)
    observed = discounted_visitation(stacked([second, first]), game.discount)
    expected = game.cost_features.total(imagined) - game.cost_features.total(observed)
    np.testing.assert_allclose(found.omega, expected, atol=1e-12)


def others(parameters: Parameters) -> dict[str, Parameters]:
    """What bob and cid send."""
    return {"bob": parameters, "cid": parameters}


def test_each_iteration_draws_from_a_generator_of_its_own_if_anything_is_drawn() -> None:
    game, exact = hallway(), build_learner(experiment({"algorithm.expectation": "exact"}), "ann").estimator
    sampled = replace(exact, expectation=SampledOccupancy(game, 2))
    first, second, again = (sampled.generator(1, 0, n).random() for n in (1, 2, 1))
    assert first == again != second
    assert first == np.random.default_rng([1, 0, 1]).random()
    assert exact.generator(1, 0, 1) is exact.generator(1, 0, 2)
