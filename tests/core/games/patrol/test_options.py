"""Options of patrols: early ends, exits, crossings, an unknown truth; and the bits of games without them."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from games import alone, crossing_diagonals, doors, patrol

from mabirds_core.algorithm.memory import stacked
from mabirds_core.arrays import Array
from mabirds_core.errors import ImpossibleTrajectoryError, UnknownTruthError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.games.interface import discounted_visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.tabular.decidable import touch_without
from mabirds_core.games.truth import known_constraints, known_rates
from mabirds_core.kernels.loading import library
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner

CONFIG = Path(__file__).parents[4] / "ros_ws" / "config"
WAIT, NORTHEAST, SOUTHEAST, SOUTHWEST = 4, 5, 6, 7


def leaving_early() -> tuple[PatrolGame, Array, Array]:
    """Expert 1 waits, then goes east to the edge and out; expert 2 is out by its own door after a diagonal step."""
    game = doors(horizon=5)
    states = np.array([[0, 0, 1, 2], [0, 0, 0, 1], [0, 1, 0, 2], [0, 2, 0, 2]], dtype=float)
    actions = np.array([[WAIT, 8], [1, 1], [1, 0], [0, 0]], dtype=float)
    return game, states, actions


def test_a_demonstration_may_end_when_all_have_left() -> None:
    game, states, actions = leaving_early()
    decoded = game.decode(states, actions)
    assert decoded.states.shape == decoded.actions.shape == (1, 6)
    cells = game.cells(decoded.states[0]).T
    assert [tuple(own) for own in cells[3:]] == [(2, 2)] * 3
    written, moved = game.encode(decoded)
    np.testing.assert_array_equal(written[:4], states)
    np.testing.assert_array_equal(moved[:4], actions)
    np.testing.assert_array_equal(game.decode(written, moved).states, decoded.states)


def test_what_is_missing_after_all_have_left_counts_nothing() -> None:
    game, states, actions = leaving_early()
    longer = doors(horizon=9)
    for features in ("cost_features", "reward_features"):
        short, long = (
            getattr(of, features).total(discounted_visitation(of.decode(states, actions), of.discount))
            for of in (game, longer)
        )
        np.testing.assert_array_equal(short, long)
        assert short.sum() > 0


def test_who_has_not_left_must_be_shown_until_the_end() -> None:
    game, states, actions = leaving_early()
    message = r"states: end at step 2 with expert 1 in \(0, 1\), no exit of it; expected all experts to have left, or 6"
    with pytest.raises(ImpossibleTrajectoryError, match=message):
        game.decode(states[:3], actions[:3])


@pytest.mark.parametrize("rows", [0, 7])
def test_nothing_and_more_than_the_horizon_are_refused(rows: int) -> None:
    game, states, actions = leaving_early()
    padded = np.pad(states, ((0, 5), (0, 0)), mode="edge"), np.pad(actions, ((0, 5), (0, 0)), mode="edge")
    with pytest.raises(ImpossibleTrajectoryError, match=r"expected \(6, 4\)"):
        game.decode(*(steps[:rows] for steps in padded))


def test_who_has_left_is_in_nobodys_way() -> None:
    game = doors()
    staying = patrol("...\n.#.", [((0, 1), (1, 2))], [(0, 2), (0, 0)])
    both = int(game.joint_state(np.array([2, 2])))  # (0, 2): a door of both
    assert game.sharing[both] == 0
    assert not game.violation[both].any()
    assert staying.sharing[both] == 1


def test_crossing_diagonals_pass_through_each_other() -> None:
    game = crossing_diagonals()
    state = int(game.joint_state(np.array([0, 1])))  # (0, 0) and (0, 1); no wait, so southeast is 5 and southwest 6
    crossing, beside = SOUTHEAST - 1, SOUTHWEST - 1
    joint = crossing * game.n_moves + beside
    assert game.swapping[state, joint] == 1
    assert game.swapping[state].sum() == 2  # the other is the swap of the two cells


def unknown() -> PatrolGame:
    return patrol("...\n...", [((0, 0), (1, 2))], [(0, 2), (1, 0)], 4, truth="unknown")


def test_what_needs_the_truth_is_none_or_refused() -> None:
    game = unknown()
    planner = SoftBellmanPlanner(game, game.linear_reward(), game.cost_features)
    theta, omega = (np.zeros(len(features.names)) for features in (game.reward_features, game.cost_features))
    policy = planner.plan(theta, omega)
    assert game.true_constraints is None
    assert game.expert_kinds == ()
    assert game.judge.imitation(policy, 0) is None
    for asked in (
        lambda: game.violation,
        lambda: game.task_reward,
        lambda: known_constraints(game),
        lambda: known_rates(game.judge, policy, 0),
        lambda: touch_without(game),
        lambda: game.true_reward().table(np.zeros(0)),
    ):
        with pytest.raises(UnknownTruthError, match="unknown"):
            asked()


def test_an_unknown_truth_changes_no_trajectories() -> None:
    known = patrol("...\n...", [((0, 0), (1, 2))], [(0, 2), (1, 0)], 4)
    assert unknown().digest == known.digest


def test_waiting_has_a_name_like_every_move() -> None:
    game = doors(diagonals=False)
    names = [name for name in game.reward_features.names if name.startswith("expert_2 in (1, 1)")]
    assert names == [f"expert_2 in (1, 1) going {way}" for way in ("north", "east", "south", "west", "nowhere")]


def test_an_impossible_move_is_named() -> None:
    game, states, actions = leaving_early()
    actions[0, 0] = NORTHEAST
    states[1, :2] = [1, 1]
    with pytest.raises(ImpossibleTrajectoryError, match=r"step 0: expert 1 moves northeast from \(0, 0\)"):
        game.decode(states, actions)


BITS = {
    "patrol.yaml": ("v2-16e4ef4cd", "a4e104ed278c"),
    "trio.yaml": ("v2-39bba7bf5", "23b76ed6959a"),
}
"""Digest of the game, and of what its experts show and one solve finds: as they were before there were options."""


@pytest.mark.skipif(library() is None, reason="kernels are not compiled")
@pytest.mark.parametrize("file", BITS)
def test_games_without_options_keep_their_bits(file: str) -> None:
    game = build_game(load_experiment(CONFIG / file))
    assert (game.digest[:12], solved(game)) == BITS[file]


def solved(game: PatrolGame) -> str:
    rng = np.random.default_rng(7)
    theta, omega = (rng.normal(size=len(of.names)) for of in (game.reward_features, game.cost_features))
    policy = SoftBellmanPlanner(game, game.linear_reward(), game.cost_features).plan(theta, -np.abs(omega))
    visits = game.expectation("exact", 1)(policy, rng)
    shown = stacked([*game.experts("soft", "by_start").demonstrations(5, rng)])
    drawn = game.expectation("sampled", 20)(policy, rng)
    totals = (of.total(seen) for of in (game.cost_features, game.reward_features) for seen in (visits, drawn))
    content = (policy.values, *totals)
    return hashlib.sha256(b"".join(np.asarray(part).tobytes() for part in (*content, *shown))).hexdigest()[:12]


def test_an_expert_alone_may_wait() -> None:
    game = PatrolGame(alone().settings.model_copy(update={"waiting": True}))
    np.testing.assert_array_equal(game.expert_successor[0, :, WAIT], np.arange(6))
