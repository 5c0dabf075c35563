"""The optimal experts against a search of the joint graph by an independent library and by enumeration."""

from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import networkx as nx
import numpy as np
import pytest

from mabirds_core.errors import InfeasibleError
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.games.tabular.experts import KINDS, OptimalExperts, SoftExperts, demonstrations

Cell = tuple[int, int]
Cells = tuple[Cell, ...]


class Rules:
    """What experts may do, with tuples: from one joint state to the next, breaking no constraint."""

    def __init__(self, settings: PatrolSettings) -> None:
        self.goals = settings.goals
        self.inside = set(product(range(len(settings.rows)), range(len(settings.rows[0]))))
        self.free = {(r, c) for r, c in self.inside if settings.rows[r][c] == "."}

    def waiting(self, state: Cells) -> int:
        return sum(cell != goal for cell, goal in zip(state, self.goals, strict=True))

    def next_cells(self, cell: Cell, goal: Cell) -> set[Cell]:
        """Where one expert may be next; off the map it stays, at its goal it rests."""
        if cell == goal:
            return {cell}
        moves = [
            (cell[0] - 1, cell[1]),
            (cell[0] + 1, cell[1]),
            (cell[0], cell[1] - 1),
            (cell[0], cell[1] + 1),
        ]
        return {there if there in self.inside else cell for there in moves} & self.free

    def next_states(self, state: Cells) -> Iterator[Cells]:
        """Clean joint successors: nobody on an obstacle, nobody sharing a cell, nobody swapping."""
        for after in product(*(self.next_cells(c, g) for c, g in zip(state, self.goals, strict=True))):
            edges = set(zip(state, after, strict=True))
            swapped = any((there, here) in edges for here, there in edges if here != there)
            if len(set(after)) == len(after) and not swapped:
                yield after

    def graph(self) -> "nx.DiGraph[Cells]":
        """Joint graph of the clean states; an edge costs the experts that wait at its beginning."""
        graph = nx.DiGraph()
        for state in product(sorted(self.free), repeat=len(self.goals)):
            if len(set(state)) == len(state):
                for after in self.next_states(state):
                    graph.add_edge(state, after, weight=self.waiting(state))
        return graph

    def plans(self, state: Cells, steps: int) -> Iterator[tuple[Cells, ...]]:
        """Every clean way of so many steps that ends at the goals."""
        if steps == 0:
            if self.waiting(state) == 0:
                yield (state,)
            return
        for after in self.next_states(state):
            for rest in self.plans(after, steps - 1):
                yield (state, *rest)


def patrol(rows: str, starts: Sequence[Cells], goals: Cells, horizon: int) -> PatrolGame:
    content = {"map": rows, "starts": starts, "goals": goals, "horizon": horizon}
    return PatrolGame(PatrolSettings.model_validate(content))


SWAP = (((0, 0), (0, 2)), ((0, 2), (0, 0)))
GAMES = {
    "one expert": patrol("...\n.#.\n...", [((0, 0),), ((0, 2),)], ((2, 2),), 6),
    "swap around an obstacle": patrol("...\n.#.\n...", [SWAP[0]], SWAP[1], 10),
    "swap with a passing place": patrol("...\n#.#", [SWAP[0]], SWAP[1], 10),
    "two starts": patrol("...\n...", [((0, 0), (0, 2)), ((1, 2), (0, 1))], ((0, 2), (0, 0)), 8),
    "three experts": patrol("..\n..", [((0, 0), (0, 1), (1, 1))], ((0, 1), (1, 1), (1, 0)), 4),
}
every_game = pytest.mark.parametrize("name", GAMES)


def paths(game: PatrolGame, count: int, seed: int = 0) -> list[tuple[Cells, ...]]:
    """The joint cells of some demonstrations, step by step."""
    found = []
    for demonstration in demonstrations(OptimalExperts(game), count, np.random.default_rng(seed)):
        positions = game.encode(demonstration)[0].astype(int).reshape(-1, game.n_experts, 2)
        found.append(tuple(tuple((int(r), int(c)) for r, c in step) for step in positions))
    return found


def cost(game: PatrolGame, path: Sequence[Cells]) -> int:
    """Total time: over all steps, the experts that have not arrived."""
    return sum(Rules(game.settings).waiting(state) for state in path)


@every_game
def test_experts_break_no_constraint(name: str) -> None:
    game, rng = GAMES[name], np.random.default_rng(1)
    for demonstration in demonstrations(OptimalExperts(game), 50, rng):
        assert not game.violation[demonstration.states, demonstration.actions].any()


@every_game
def test_experts_move_by_clean_steps_of_the_joint_graph(name: str) -> None:
    rules = Rules(GAMES[name].settings)
    for path in paths(GAMES[name], 20):
        for here, there in pairwise(path):
            assert there in rules.next_states(here)


@every_game
def test_experts_start_at_the_starts_and_end_at_their_goals(name: str) -> None:
    game = GAMES[name]
    found = paths(game, 50)
    assert {path[0] for path in found} == set(game.settings.starts)
    assert {path[-1] for path in found} == {game.settings.goals}


@every_game
def test_experts_take_the_least_total_time(name: str) -> None:
    game = GAMES[name]
    graph = Rules(game.settings).graph()
    for path in paths(game, 30):
        least = nx.dijkstra_path_length(graph, path[0], game.settings.goals)
        assert cost(game, path) == least > 0


@every_game
def test_values_are_minus_the_least_total_time_and_minus_infinity_where_no_clean_way_leads(name: str) -> None:
    settings = GAMES[name].settings.model_copy(update={"horizon": 20})
    game, least = PatrolGame(settings), np.full(GAMES[name].n_states, np.inf)
    to_goal = nx.single_source_dijkstra_path_length(Rules(settings).graph().reverse(), settings.goals)
    for state, time in to_goal.items():
        least[game.joint_state(np.array([game.cell_index(cell) for cell in state]))] = time
    np.testing.assert_array_equal(OptimalExperts(game).values[0], -least)
    assert 1 < np.isfinite(least).sum() < game.n_states or game.n_experts == 1


def optimal_plans(game: PatrolGame, start: Cells) -> set[tuple[Cells, ...]]:
    every = list(Rules(game.settings).plans(start, game.horizon))
    least = min(cost(game, plan) for plan in every)
    return {plan for plan in every if cost(game, plan) == least}


@pytest.mark.parametrize(
    "game",
    [
        patrol("...\n.#.\n...", [((0, 0),)], ((2, 2),), 4),
        patrol("..\n..", [((0, 0), (1, 1))], ((1, 1), (0, 0)), 3),
        patrol("...\n...", [SWAP[0]], SWAP[1], 5),
    ],
    ids=["one expert", "two at opposite corners", "two that give way"],
)
def test_every_optimal_joint_plan_occurs_and_no_other(game: PatrolGame) -> None:
    expected = optimal_plans(game, game.settings.starts[0])
    assert len(expected) > 1
    assert set(paths(game, 60 * len(expected))) == expected


def test_equally_good_joint_actions_are_equally_likely() -> None:
    """One expert two moves from its goal at the opposite corner: east and south, a half each."""
    experts = OptimalExperts(patrol("..\n..", [((0, 0),)], ((1, 1),), 3))
    chances = np.exp(experts.log_probabilities(0, np.array([0])))
    np.testing.assert_allclose(chances, [[0, 1 / 2, 1 / 2, 0]], atol=1e-15)


def test_a_state_with_no_clean_way_has_no_action() -> None:
    experts = OptimalExperts(patrol(".#.", [((0, 2),)], ((0, 2),), 5))
    assert np.isneginf(experts.values[0, 0])
    assert np.isneginf(experts.log_probabilities(0, np.array([0]))).all()


def test_the_same_seed_gives_the_same_demonstrations_and_another_seed_others() -> None:
    game = GAMES["swap around an obstacle"]
    assert paths(game, 20, seed=1) == paths(game, 20, seed=1)
    assert paths(game, 20, seed=1) != paths(game, 20, seed=2)


def test_as_many_demonstrations_come_as_are_asked_for() -> None:
    assert len(paths(GAMES["one expert"], 7)) == 7
    assert paths(GAMES["one expert"], 0) == []


@pytest.mark.parametrize(
    ("game", "message"),
    [
        (patrol(".#.", [((0, 0),)], ((0, 2),), 9), "1 of 1 starts have no way to the goal within 9 steps"),
        (patrol("...", [SWAP[0]], SWAP[1], 30), "1 of 1 starts have no way to the goal within 30 steps"),
        (
            patrol("..#.", [((0, 0),), ((0, 3),)], ((0, 1),), 4),
            "1 of 2 starts have no way to the goal within 4 steps",
        ),
        (patrol(".....", [((0, 0),)], ((0, 4),), 2), "1 of 1 starts have no way to the goal within 2 steps"),
    ],
    ids=["walled off", "corridor without passing place", "one of two starts", "too far"],
)
def test_starts_without_a_clean_way_are_infeasible_with_a_remedy(game: PatrolGame, message: str) -> None:
    with pytest.raises(InfeasibleError) as caught:
        next(demonstrations(OptimalExperts(game), 1, np.random.default_rng(0)))
    assert str(caught.value).startswith(message)
    assert str(caught.value).endswith(
        "that breaks no constraint; change the starts, the map, the deadline or the horizon"
    )


def corridor(distance: int, horizon: int) -> OptimalExperts:
    """One expert, ``distance`` moves from its goal."""
    return OptimalExperts(patrol("." * (distance + 1), [((0, 0),)], ((0, distance),), horizon))


@pytest.mark.parametrize("distance", [1, 2, 3])
def test_a_goal_that_takes_as_many_moves_as_the_horizon_is_reached(distance: int) -> None:
    (arrived,) = demonstrations(corridor(distance, horizon=distance), 1, np.random.default_rng(0))
    assert arrived.states.tolist() == [list(range(distance + 1))]


@pytest.mark.parametrize("distance", [2, 3])
def test_a_goal_that_takes_one_move_more_than_the_horizon_is_infeasible(distance: int) -> None:
    """A trajectory has T moves between its states s_0..s_T: arriving by the action of step T is too late."""
    with pytest.raises(InfeasibleError):
        list(demonstrations(corridor(distance, horizon=distance - 1), 1, np.random.default_rng(0)))


def every_way(game: PatrolGame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States and actions of all action sequences from the only start, and which are clean and in time."""
    actions = np.array(list(product(range(game.n_actions), repeat=game.horizon + 1)))
    states = np.full_like(actions, int(np.flatnonzero(game.initial_distribution)[0]))
    for step in range(game.horizon):
        states[:, step + 1] = game.successor[states[:, step], actions[:, step]]
    clean = ~game.violation[states, actions].any(axis=1)
    return states, actions, clean & game.goal[states[:, game.deadline :]].all(axis=1)


@pytest.mark.parametrize(("step_cost", "deadline"), [(0.0, 4), (0.7, 5), (2.0, 3)])
def test_soft_experts_draw_every_clean_way_with_the_probability_of_its_reward(step_cost: float, deadline: int) -> None:
    content = {"map": "...\n.#.", "starts": [[(0, 0)]], "goals": [(0, 2)], "horizon": 5, "discount": 0.5}
    game = PatrolGame(PatrolSettings.model_validate({**content, "step_cost": step_cost, "deadline": deadline}))
    states, actions, allowed = every_way(game)
    weights = np.where(allowed, np.exp(game.task_reward[states, actions].sum(axis=1)), 0.0)
    experts = SoftExperts(game)
    with np.errstate(invalid="raise"):
        logs = sum(
            experts.log_probabilities(step, states[:, step])[np.arange(len(actions)), actions[:, step]]
            for step in range(game.horizon + 1)
        )
    np.testing.assert_allclose(np.exp(logs), weights / weights.sum(), rtol=0, atol=1e-12)
    assert 1 < allowed.sum() < len(allowed)


def test_soft_experts_keep_the_deadline_and_every_constraint() -> None:
    game = PatrolGame(
        PatrolSettings(
            map="....\n.##.\n....", starts=(((0, 0), (2, 3)),), goals=((2, 3), (0, 0)), horizon=12, deadline=9
        )
    )
    arrivals = set()
    for one in demonstrations(SoftExperts(game), 200, np.random.default_rng(0)):
        assert not game.violation[one.states, one.actions].any()
        arrivals.add(int(game.goal[one.states[0]].argmax()))
        assert game.goal[one.states[0, 9:]].all()
    assert min(arrivals) == 5
    assert len(arrivals) > 1


def test_optimal_experts_keep_a_deadline_before_the_horizon() -> None:
    game = PatrolGame(
        PatrolSettings(map="...", starts=(((0, 0),),), goals=((0, 2),), horizon=9, deadline=4, step_cost=0)
    )
    for one in demonstrations(OptimalExperts(game), 50, np.random.default_rng(0)):
        assert game.goal[one.states[0, 4:]].all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_deadline_that_cannot_be_kept_is_infeasible(kind: str) -> None:
    game = PatrolGame(PatrolSettings(map="....", starts=(((0, 0),),), goals=((0, 3),), horizon=9, deadline=2))
    with pytest.raises(InfeasibleError, match="1 of 1 starts have no way to the goal within 2 steps"):
        next(demonstrations(KINDS[kind](game), 1, np.random.default_rng(0)))
