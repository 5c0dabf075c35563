"""The patrol game against its rules written once more with tuples and loops; decoding; settings."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from games import SlowPatrol, alone, crossing_diagonals, doors, hallway, patrol, random_policy, trio
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from mabirds_core.arrays import Array
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.planners.occupancy import rollouts

GAMES: list[Callable[[], PatrolGame]] = [alone, hallway, trio, doors, crossing_diagonals]
every_game = pytest.mark.parametrize("build", GAMES, ids=lambda build: build.__name__)


def slow_table(slow: SlowPatrol, function: Callable[..., Any]) -> Array:
    """function(s, a) for every joint state and action."""
    return np.array([[function(state, action) for action in slow.actions] for state in slow.states])


@every_game
def test_states_and_actions_are_all_joint_cells_and_moves_in_order(build: Callable[[], PatrolGame]) -> None:
    game = build()
    slow = SlowPatrol(game.settings)
    assert (game.n_states, game.n_actions) == (len(slow.states), len(slow.actions))
    cells = game.cells(np.arange(game.n_states)).T
    assert [tuple(divmod(int(c), game.width) for c in own) for own in cells] == slow.states
    assert [tuple(own) for own in game.moves(np.arange(game.n_actions)).T] == slow.actions


@every_game
def test_joint_state_is_the_inverse_of_cells(build: Callable[[], PatrolGame]) -> None:
    game = build()
    everywhere = np.arange(game.n_states)
    np.testing.assert_array_equal(game.joint_state(game.cells(everywhere)), everywhere)


@every_game
def test_successor_moves_every_expert_by_the_rules(build: Callable[[], PatrolGame]) -> None:
    game = build()
    slow = SlowPatrol(game.settings)
    index = {state: number for number, state in enumerate(slow.states)}
    expected = slow_table(slow, lambda state, action: index[slow.after(state, action)])
    np.testing.assert_array_equal(game.successor, expected)


def test_an_expert_moves_stays_at_the_edge_and_rests_at_its_goal() -> None:
    """One expert on 3x2 cells with the goal (2, 0): the four moves from three cells, by hand."""
    game = alone()
    for cell, expected in [
        ((0, 0), [(0, 0), (0, 1), (1, 0), (0, 0)]),
        ((1, 1), [(0, 1), (1, 1), (2, 1), (1, 0)]),
        ((2, 0), [(2, 0)] * 4),
    ]:
        after = [divmod(int(there), game.width) for there in game.successor[game.cell_index(cell)]]
        assert after == expected


@every_game
def test_sharing_counts_the_pairs_in_one_cell(build: Callable[[], PatrolGame]) -> None:
    game = build()
    slow = SlowPatrol(game.settings)
    np.testing.assert_array_equal(game.sharing, [slow.sharing(state) for state in slow.states])


@every_game
def test_swapping_counts_the_pairs_that_exchange_cells(build: Callable[[], PatrolGame]) -> None:
    game = build()
    slow = SlowPatrol(game.settings)
    np.testing.assert_array_equal(game.swapping, slow_table(slow, slow.swapping))


def test_three_experts_can_share_three_times_and_swap_once_beside_sharing() -> None:
    game = trio()
    assert game.sharing.max() == 3
    assert game.swapping.max() == 2  # two experts in one cell, each swapping with the third


@every_game
def test_violation_is_an_obstacle_a_shared_cell_or_a_swap(build: Callable[[], PatrolGame]) -> None:
    game = build()
    slow = SlowPatrol(game.settings)
    np.testing.assert_array_equal(game.violation, slow_table(slow, slow.violates))


@every_game
def test_a_pair_violates_if_and_only_if_a_true_constraint_feature_is_active(
    build: Callable[[], PatrolGame],
) -> None:
    game = build()
    active = game.cost_features.table(game.true_constraints.astype(float)) > 0
    np.testing.assert_array_equal(game.violation, active)


@every_game
def test_the_goal_is_where_nobody_waits_and_the_task_reward_counts_who_does(
    build: Callable[[], PatrolGame],
) -> None:
    game = build()
    slow = SlowPatrol(game.settings)
    waiting = np.array([slow.waiting(state) for state in slow.states])
    np.testing.assert_array_equal(game.goal, waiting == 0)
    np.testing.assert_array_equal(game.task_reward, slow_table(slow, lambda state, _: -slow.waiting(state)))
    assert game.goal.sum() == np.prod([len(cells) for cells in game.settings.goal_cells])


def test_the_initial_distribution_has_the_given_probabilities_at_the_starts() -> None:
    game = hallway()
    states = SlowPatrol(game.settings).states
    starts = np.flatnonzero(game.initial_distribution)
    chances = {states[start]: float(game.initial_distribution[start]) for start in starts}
    assert chances == {((0, 0), (0, 2)): 0.25, ((1, 0), (0, 1)): 0.75}


def test_starts_are_equally_likely_by_default() -> None:
    distribution = alone().initial_distribution
    assert sorted(distribution[distribution > 0]) == [0.5, 0.5]


def test_a_start_given_twice_is_twice_as_likely() -> None:
    game = patrol("...", [((0, 0),), ((0, 0),), ((0, 1),)], ((0, 2),))
    np.testing.assert_allclose(game.initial_distribution, [2 / 3, 1 / 3, 0], atol=1e-15)


@given(seed=st.integers(0, 2**32 - 1), number=st.integers(0, len(GAMES) - 1))
def test_decoding_inverts_encoding(seed: int, number: int) -> None:
    game, rng = GAMES[number](), np.random.default_rng(seed)
    trajectory = rollouts(game, random_policy(game, rng), 1, rng)
    states, actions = game.encode(trajectory)
    assert states.shape == (game.horizon + 1, 2 * game.n_experts)
    assert actions.shape == (game.horizon + 1, game.n_experts)
    decoded = game.decode(states, actions)
    np.testing.assert_array_equal(decoded.states, trajectory.states)
    np.testing.assert_array_equal(decoded.actions, trajectory.actions)


def crossing() -> tuple[PatrolGame, Array, Array]:
    """A game with T = 2 and a trajectory by hand: expert 1 goes east twice, expert 2 south and west."""
    game = hallway()
    states = np.array([[0, 0, 0, 2], [0, 1, 1, 2], [0, 2, 1, 1]], dtype=float)
    return game, states, np.array([[1, 2], [1, 3], [2, 0]], dtype=float)


def test_encoding_gives_row_and_column_then_moves_expert_by_expert() -> None:
    game, states, actions = crossing()
    index = {state: number for number, state in enumerate(SlowPatrol(game.settings).states)}
    joint = [[index[(0, 0), (0, 2)], index[(0, 1), (1, 2)], index[(0, 2), (1, 1)]]]
    encoded = game.encode(Trajectories(np.array(joint), np.array([[1 * 4 + 2, 1 * 4 + 3, 2 * 4 + 0]])))
    np.testing.assert_array_equal(encoded[0], states)
    np.testing.assert_array_equal(encoded[1], actions)
    assert encoded[0].dtype == encoded[1].dtype == np.float64


@pytest.mark.parametrize(
    ("which", "shape"),
    [("states", (2, 4)), ("states", (3, 3)), ("states", (12,)), ("actions", (3, 3)), ("actions", ())],
)
def test_a_wrong_shape_is_refused_with_both_shapes(which: str, shape: tuple[int, ...]) -> None:
    game, states, actions = crossing()
    given_arrays = {"states": states, "actions": actions}
    expected = given_arrays[which].shape
    given_arrays[which] = np.zeros(shape)
    with pytest.raises(ImpossibleTrajectoryError) as caught:
        game.decode(**given_arrays)
    assert str(caught.value) == f"{which}: shape {shape}, expected {expected}"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.5, -1.0, 1e300])
@pytest.mark.parametrize(
    ("which", "step", "column", "last"), [("states", 1, 3, 2), ("states", 2, 2, 1), ("actions", 0, 1, 3)]
)
def test_a_value_that_is_no_cell_or_move_is_refused_by_step_and_column(
    which: str, step: int, column: int, last: int, value: float
) -> None:
    game, states, actions = crossing()
    {"states": states, "actions": actions}[which][step, column] = value
    with pytest.raises(ImpossibleTrajectoryError) as caught:
        game.decode(states, actions)
    opening = f"{which} at step {step}, column {column}: {value}"
    assert str(caught.value) == f"{opening}, expected a whole number from 0 to {last}"


@pytest.mark.parametrize(
    ("which", "column", "value"),
    [("states", 0, 2.0), ("states", 1, 3.0), ("states", 3, 3.0), ("actions", 0, 4.0)],
)
def test_the_first_value_out_of_range_is_refused(which: str, column: int, value: float) -> None:
    game, states, actions = crossing()
    {"states": states, "actions": actions}[which][1, column] = value
    message = f"{which} at step 1, column {column}: {value}, expected"
    with pytest.raises(ImpossibleTrajectoryError, match=message):
        game.decode(states, actions)


def test_an_impossible_transition_names_the_step_the_expert_and_the_possible_cell() -> None:
    game, states, actions = crossing()
    states[2] = [0, 2, 0, 2]
    with pytest.raises(ImpossibleTrajectoryError) as caught:
        game.decode(states, actions)
    expected = "step 1: expert 2 moves west from (1, 2) and is then at (0, 2); the game allows only (1, 1)"
    assert str(caught.value) == expected


def test_the_first_impossible_transition_is_the_one_named() -> None:
    game, states, actions = crossing()
    states[1], states[2] = [1, 0, 1, 1], [0, 0, 0, 0]
    with pytest.raises(ImpossibleTrajectoryError, match=r"^step 0: expert 1 moves east from \(0, 0\)"):
        game.decode(states, actions)


SETTINGS: dict[str, Any] = {
    "map": "...\n.#.",
    "starts": [[[0, 0], [0, 2]]],
    "goals": [[0, 2], [0, 0]],
    "horizon": 4,
}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"map": "...\n.."}, "map\n.*rows of '.' and '#' of one length.*input_value='...\\\\n..'"),
        ({"map": "...\n.x."}, "map\n.*rows of '.' and '#' of one length"),
        ({"map": " "}, "map\n.*rows of '.' and '#'"),
        ({"starts": [[[1, 1], [0, 2]]]}, r"cell \(1, 1\) .*: expected a free cell of the 2x3 map"),
        ({"starts": [[[0, 3], [0, 2]]]}, r"cell \(0, 3\) .*: expected a free cell"),
        ({"starts": [[[-1, 0], [0, 2]]]}, r"cell \(-1, 0\) .*: expected a free cell"),
        ({"starts": [[[0, 0]]]}, r"start \(\(0, 0\),\): expected 2 different cells"),
        ({"starts": [[[0, 1], [0, 1]]]}, r"start \(\(0, 1\), \(0, 1\)\): expected 2 different cells"),
        ({"starts": []}, "starts\n"),
        ({"goals": [[1, 1], [0, 0]]}, r"cell \(1, 1\) .*: expected a free cell"),
        (
            {"goals": [[0, 0], [0, 0]]},
            r"goals \(\(0, 0\), \(0, 0\)\): expected a different goal for each expert",
        ),
        ({"goals": [[[0, 2], [0, 1]], [[0, 1]]]}, r"expected a different goal for each expert; exits can be shared"),
        ({"goals": [[0, 2], []]}, r"goals .*: expected at least one cell for each expert"),
        ({"goals": [[0, 2], [[0, 0], [1, 1]]]}, r"cell \(1, 1\) .*: expected a free cell"),
        ({"slip": 1.0}, "slip\n.*input_value=1.0"),
        ({"slip": -0.1}, "slip\n.*input_value=-0.1"),
        ({"truth": "unknown"}, "truth unknown: expected a map without '#'"),
        ({"goals": []}, "goals\n"),
        ({"start_probabilities": [0.5, 0.5]}, r"start_probabilities \(0.5, 0.5\): expected 1 numbers"),
        ({"start_probabilities": [0.9]}, r"start_probabilities \(0.9,\): expected 1 numbers >= 0 with sum 1"),
        ({"start_probabilities": [np.nan]}, r"start_probabilities.0\n.*input_value=nan"),
        ({"start_probabilities": []}, r"start_probabilities \(\): expected 1 numbers"),
        ({"horizon": 0}, "horizon\n.*input_value=0"),
        ({"horizon": 2.5}, "horizon\n.*input_value=2.5"),
        ({"discount": 0}, "discount\n.*input_value=0"),
        ({"discount": 1.01}, "discount\n.*input_value=1.01"),
        ({"discount": np.nan}, "discount\n.*input_value=nan"),
        ({"kind": "chess"}, "kind\n.*'patrol'.*input_value='chess'"),
        ({"speed": 3}, "speed\n.*input_value=3"),
    ],
    ids=lambda value: str(value)[:40] if isinstance(value, dict) else "",
)
def test_wrong_settings_are_refused_by_place_and_value(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        PatrolSettings.model_validate({**SETTINGS, **wrong})


def test_a_negative_probability_is_refused_even_if_the_sum_is_one() -> None:
    two = {"starts": SETTINGS["starts"] * 2, "start_probabilities": [-0.5, 1.5]}
    with pytest.raises(ValidationError, match=r"start_probabilities \(-0.5, 1.5\)"):
        PatrolSettings.model_validate({**SETTINGS, **two})


@pytest.mark.parametrize("thirds", [[0.333333] * 3, [0.33333334, 0.33333334, 0.33333334]])
def test_probabilities_are_refused_or_good_enough_to_draw_from(thirds: list[float]) -> None:
    """What the settings accept, rollouts must accept: rounded probabilities fail when read, or never."""
    starts = [[[0, 0], [0, 2]], [[0, 1], [0, 2]], [[1, 0], [0, 2]]]
    content = {**SETTINGS, "starts": starts, "start_probabilities": thirds}
    try:
        settings = PatrolSettings.model_validate(content)
    except ValidationError:
        return
    game, rng = PatrolGame(settings), np.random.default_rng(0)
    assert game.initial_distribution.sum() == pytest.approx(1, abs=1e-9)
    rollouts(game, random_policy(game, rng), 2, rng)


def test_the_map_may_be_indented_and_end_with_an_empty_line() -> None:
    tidy, loose = (
        PatrolSettings.model_validate({**SETTINGS, "map": text}) for text in ("...\n.#.", "  ...\n  .#.\n\n")
    )
    assert tidy == loose
    assert PatrolGame(tidy).digest == PatrolGame(loose).digest


@pytest.mark.parametrize(
    ("change", "decides"),
    [
        ({"map": "...\n.#.\n..."}, True),
        ({"goals": [[0, 2], [1, 0]]}, True),
        ({"horizon": 5}, True),
        ({"map": "...\n..."}, False),
        ({"starts": [[[0, 0], [1, 0]]]}, False),
        ({"discount": 0.9}, False),
        ({"start_probabilities": [1.0]}, False),
        ({"goals": [[0, 2], [[0, 0]]]}, False),
        ({"goals": [[0, 2], [[0, 0], [0, 1]]]}, True),
        ({"waiting": True}, True),
        ({"diagonals": True}, True),
        ({"leaving": True}, True),
        ({"slip": 0.1}, True),
        ({"slip": 0.0, "waiting": False}, False),
        ({"violation_cost": 3.0}, False),
    ],
    ids=str,
)
def test_the_digest_changes_with_what_decides_trajectories_alone(change: dict[str, Any], decides: bool) -> None:
    original, changed = (PatrolSettings.model_validate({**SETTINGS, **extra}) for extra in ({}, change))
    assert (PatrolGame(original).digest != PatrolGame(changed).digest) is decides


def test_a_deadline_after_the_horizon_is_refused() -> None:
    with pytest.raises(ValidationError, match="deadline 5: expected a step up to the horizon, 4"):
        PatrolSettings(map="..", starts=(((0, 0),),), goals=((0, 1),), horizon=4, deadline=5)


def test_the_deadline_is_the_horizon_unless_it_is_given() -> None:
    settings = PatrolSettings(map="..", starts=(((0, 0),),), goals=((0, 1),), horizon=4)
    assert PatrolGame(settings).deadline == 4
    assert PatrolGame(settings.model_copy(update={"deadline": 3})).deadline == 3


def test_a_step_costs_every_expert_under_way_as_much_as_the_settings_say() -> None:
    settings = PatrolSettings(map="..", starts=(((0, 0),),), goals=((0, 1),), horizon=4, step_cost=0.25)
    np.testing.assert_array_equal(PatrolGame(settings).task_reward, [[-0.25] * 4, [0.0] * 4])
