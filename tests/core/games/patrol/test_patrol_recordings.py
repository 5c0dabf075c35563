"""Recorded places as patrols, and patrols judged by patrols that were held out."""

import numpy as np
import pytest

from mabirds_core.errors import ExperimentError
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.held_out import ByExpert, PatrolForecast, Ways
from mabirds_core.games.patrol.recorded import cells_of, centres_of, observed_settings
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.games.patrol.whole_game import WholePatrolGame
from mabirds_core.games.recordings import Goal, Observed
from mabirds_core.planners.occupancy import rollouts
from mabirds_core.planners.soft_bellman import soft_bellman_policy

STARTS = np.array([[[0.3, 0.3], [3.7, 2.6]], [[0.4, 0.2], [3.8, 2.9]], [[1.2, 0.3], [3.7, 2.6]]])


def observed(starts: np.ndarray = STARTS) -> Observed:
    goals = [Goal((3.5, 0.5), 0.6, None), Goal((0.0, 2.5), 0.6, (0.0, 0.5))]
    return Observed((4.0, 3.0), starts, goals, 1.0, 8, 1.0)


@pytest.fixture(scope="module")
def game() -> WholePatrolGame:
    return WholePatrolGame(PatrolSettings(**observed_settings(observed())["game"]))


@pytest.fixture(scope="module")
def shown(game: WholePatrolGame) -> Trajectories:
    policy = soft_bellman_policy(game, -1.0 * game.held_out_judge.under_way)
    return rollouts(game, policy, 30, np.random.default_rng(1))


def test_places_are_in_cells_and_the_largest_y_is_on_top() -> None:
    places = np.array([[0.1, 0.1], [3.9, 0.1], [0.1, 2.9], [-5.0, 9.0]])
    np.testing.assert_array_equal(cells_of(places, 1.0, 3, 4), [8, 11, 0, 0])
    every = np.arange(12)
    np.testing.assert_array_equal(cells_of(centres_of(every, 1.0, 3, 4), 1.0, 3, 4), every)


def test_the_game_covers_the_area(game: WholePatrolGame) -> None:
    settings = game.settings
    assert settings.rows == ["....", "....", "...."]
    assert settings.starts == (((2, 0), (0, 3)), ((2, 1), (0, 3)))  # two of the three begin in the same cells
    assert settings.goal_cells == (((2, 3),), ((0, 0), (1, 0), (2, 0)))  # a disc, and a door along the left edge
    assert (settings.cell, settings.truth, settings.leaving) == (1.0, "unknown", True)


def test_starts_in_one_cell_are_refused() -> None:
    with pytest.raises(ExperimentError, match="begin with two agents in one cell of 1 m"):
        observed_settings(observed(np.zeros((2, 2, 2))))


def test_patrols_told_as_places_come_back(game: WholePatrolGame, shown: Trajectories) -> None:
    for states, actions in zip(*shown, strict=True):
        after = game.successor[states[-1], actions[-1]]
        cells = game.cells(np.append(states, after)).T
        fit = game.fit_places(centres_of(cells, 1.0, 3, 4))
        np.testing.assert_array_equal(fit.trajectory.states[0], states)
        again = game.decode(*game.encode(fit.trajectory))
        np.testing.assert_array_equal(again.states, fit.trajectory.states)
        np.testing.assert_array_equal(fit.arrived.all(axis=1), game.goal[states])


def test_who_is_too_fast_follows_behind(game: WholePatrolGame) -> None:
    places = np.repeat([[[0.5, 0.5], [3.5, 2.5]]], game.horizon + 2, axis=0)
    places[1:, 0] = [2.5, 2.5]
    fit = game.fit_places(places)
    assert fit.places[:3, 0].tolist() == [[0.5, 0.5], [1.5, 1.5], [2.5, 2.5]]
    assert (fit.places[:, 1] == [3.5, 2.5]).all()


def test_ratios_are_those_of_joint_states_by_hand(game: WholePatrolGame, shown: Trajectories) -> None:
    policy = soft_bellman_policy(game, -1.0 * game.held_out_judge.under_way)
    expected = np.zeros(len(shown.states))
    for row, (states, actions) in enumerate(zip(*shown, strict=True)):
        for step, (state, action) in enumerate(zip(states, actions, strict=True)):
            if game.goal[state]:
                continue
            chances = np.exp(policy.log_probabilities(step, np.array([state]))[0])
            same = [a for a in range(game.n_actions) if game.successor[state, a] == game.successor[state, action]]
            expected[row] += np.log(chances[same].sum() / (len(same) / game.n_actions))
    found = game.held_out_judge.of_policy(policy).log_ratios(shown)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_baselines_are_in_their_order(game: WholePatrolGame, shown: Trajectories) -> None:
    judge = game.held_out_judge
    forecasts = judge.baselines(None, None, shown)
    policy = soft_bellman_policy(game, -1.0 * judge.under_way)
    others = rollouts(game, policy, 200, np.random.default_rng(2))
    nats = {name: float(of.log_ratios(others).mean()) for name, of in forecasts.items()}
    assert nats["uniform"] == pytest.approx(0.0, abs=1e-12)
    assert nats["maximum entropy, goals told"] == max(nats.values())  # they did so
    assert min(nats[name] for name in nats if name != "uniform") > 0


def test_constant_velocity_goes_on_as_it_was_told(game: WholePatrolGame) -> None:
    start = game.joint_state(np.array([8, 3]))
    east_and_west = game.grid.move_names.index("east") * game.n_moves + game.grid.move_names.index("west")
    told = Trajectories(np.array([[start]]), np.array([[east_and_west]]))
    same = PatrolForecast(game, ByExpert(game, Ways(game).same(0.05)), told=True)
    walked = same.rollouts(told, 2, np.random.default_rng(1))
    np.testing.assert_array_equal(game.cells(walked.states[0])[:, :4], [[8, 9, 10, 11], [3, 2, 1, 0]])


def test_what_is_shown_is_nowhere_away_from_itself(game: WholePatrolGame, shown: Trajectories) -> None:
    judge = game.held_out_judge
    average, final = judge.displacements(shown, shown, 1)
    assert not average.any()
    assert not final.any()
    shifted = Trajectories(np.full_like(shown.states, shown.states[0, 0]), shown.actions)
    assert (judge.displacements(shown, shifted, 1)[1][:, 0] >= 1.0).all()
    assert judge.conflicts(shown)["sharing"] == pytest.approx((game.sharing[shown.states] > 0).any(axis=1).mean())


def test_patrols_without_metres_are_refused(game: WholePatrolGame) -> None:
    plain = WholePatrolGame(game.settings.model_copy(update={"cell": None}))
    with pytest.raises(ExperimentError, match="game.cell"):
        plain.fit_places(np.zeros((10, 2, 2)))
    with pytest.raises(ExperimentError, match=r"expected \(10, 2, 2\)"):
        game.fit_places(np.zeros((9, 2, 2)))
