"""Word of what was shown: it reaches everybody, changes nothing else, and keeps learners from calling it forbidden."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from mabirds_core.algorithm.memory import stacked
from mabirds_core.arrays import Mask
from mabirds_core.experiment.assembly import build_game, build_learner, learners_reward
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Streams, simulate
from mabirds_core.games.interface import shown_features
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.rewards.shown import RewardWithShown

LEARNED: dict[str, Any] = {
    "name": "shown",
    "game": {
        "map": ".....\n.#.#.\n.....",
        "starts": [[[0, 0], [2, 4]], [[2, 0], [0, 4]]],
        "goals": [[0, 4], [2, 0]],
        "horizon": 12,
    },
    "learners": ["ann", "bob", "cyd", "dan"],
    "schedule": {"kind": "alternating"},
    "demonstrations": {"bag": "none", "per_learner": 3, "experts": "soft"},
    "iterations": 3,
    "closing_rounds": 40,
    "seed": 5,
}
RESILIENT = {"mixing": {"kind": "resilient"}}
NEURAL = {"algorithm": {"reward": {"kind": "neural", "hidden": 3}}}
OWN = {"algorithm": {"share_shown": False}}


def told(**changes: Any) -> Experiment:
    return Experiment.model_validate({**LEARNED, **changes})


@cache
def streams() -> Streams:
    experiment, rng = told(), np.random.default_rng(5)
    game: Any = build_game(experiment)
    return {name: list(game.experts("soft", "by_start").demonstrations(3, rng)) for name in experiment.learners}


def learned(experiment: Experiment) -> tuple[PatrolGame, RewardWithShown, History]:
    game: Any = build_game(experiment)
    reward: Any = learners_reward(experiment, game)
    return game, reward, simulate(experiment, streams())


def by_learner(game: PatrolGame, count: int = 3) -> dict[str, Mask]:
    """Which features each learner was shown by its first demonstrations."""
    return {name: shown_features(game, stacked(list(stream)[:count])).used for name, stream in streams().items()}


@pytest.mark.parametrize("mixing", [{}, RESILIENT])
def test_what_theta_says_tends_to_the_share_of_learners_and_is_positive_where_any_was_shown(mixing: Any) -> None:
    game, reward, history = learned(told(**mixing))
    own = by_learner(game)
    share = np.mean([*own.values()], axis=0)
    assert ((share > 0) & (share < 1)).sum() > 0  # something was shown to some of them
    for parameters in history.values():
        shares = parameters[-1].theta[-len(share) :]
        np.testing.assert_allclose(shares, share, rtol=0, atol=1e-4)
        np.testing.assert_array_equal(shares > 0, share > 0)
        np.testing.assert_array_equal(reward.shown(parameters[-1].theta, 12).used, share > 0)


@pytest.mark.parametrize("changes", [{}, RESILIENT, NEURAL])
def test_all_else_is_learned_to_the_last_bit_as_without(changes: Any) -> None:
    experiment = told(**changes)
    _, reward, with_word = learned(experiment)
    alone = experiment.algorithm.model_copy(update={"share_shown": False})
    without = simulate(experiment.model_copy(update={"algorithm": alone}), streams())
    for name, parameters in with_word.items():
        for step, same in zip(parameters, without[name], strict=True):
            assert step.theta[: reward.reward.size].tobytes() == same.theta.tobytes()
            assert step.omega.tobytes() == same.omega.tobytes()


def test_word_travels_one_open_edge_an_iteration() -> None:
    """After the first update a learner knows what itself was shown; after the second what its senders were, too."""
    game, reward, history = learned(told())
    schedule, first = told().edge_schedule, by_learner(game, 1)
    for name, parameters in history.items():
        np.testing.assert_array_equal(reward.shown(parameters[1].theta, 4).used, first[name])
        known = np.any([first[sender] for sender in schedule.senders_to(name, 2)] + [by_learner(game, 2)[name]], axis=0)
        np.testing.assert_array_equal(reward.shown(parameters[2].theta, 8).used, known)


def test_a_learner_counts_the_demonstrations_of_all_or_its_own() -> None:
    for experiment, count in ((told(), 4 * 3), (told(**OWN), 3)):
        learner = build_learner(experiment, "ann")
        state = learner.initial_state()
        for n, demonstration in enumerate(list(streams()["ann"])[:3], start=1):
            senders = learner.mixer.schedule.senders_to("ann", n)
            state = learner.step(state, demonstration, dict.fromkeys(senders, state.parameters)).state
        shown = learner.shown(state)
        assert shown is not None
        assert shown.demonstrations == count
        used = shown_features(learner.game, stacked(list(streams()["ann"])[:3])).used
        np.testing.assert_array_equal(shown.used, used)


def test_there_is_no_word_where_nobody_asks_for_it_or_demonstrations_are_forgotten() -> None:
    for algorithm in ({"window": 1}, OWN["algorithm"]):
        experiment = told(algorithm=algorithm)
        assert not isinstance(learners_reward(experiment, build_game(experiment)), RewardWithShown)


def test_theta_is_named() -> None:
    game, reward, _ = learned(told())
    assert len(reward.names) == reward.size
    assert reward.names[-len(game.cost_features.names) :] == tuple(f"shown: {n}" for n in game.cost_features.names)
