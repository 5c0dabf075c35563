"""The pedestrians' benchmark: densities against scipy, gradients by differences, intervals, made-up walkers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_command import printed
from games import central_differences
from scipy import integrate, stats
from walkers import write_walkers

from mabirds_bringup.bench.pedestrians.choosing import shared, splits
from mabirds_bringup.bench.pedestrians.data import HEADINGS, Pair, imported, pairs, read_pedestrians
from mabirds_bringup.bench.pedestrians.features import LEVELS, PlaceGrid
from mabirds_bringup.bench.pedestrians.forecasts import Scored, Training, gaussian, nats, same_way
from mabirds_bringup.bench.pedestrians.game import StepExpectation, StepGame, StepPolicy
from mabirds_bringup.bench.pedestrians.judging import pigeonhole_weights, weighted_estimate
from mabirds_bringup.bench.pedestrians.learning import Network
from mabirds_bringup.bench.pedestrians.measure import distances, features_over
from mabirds_bringup.bench.pedestrians.moves import Moves
from mabirds_bringup.bench.pedestrians.situations import Situations, Walk, decisions
from mabirds_bringup.bench.pedestrians.walking import Scene, constant, displacements, drawn_by
from mabirds_bringup.importing.importer import Import
from mabirds_core.games.interface import Trajectories, discounted_visitation
from mabirds_msgs_py.errors import BagError

MOVES = Moves()
FEATURES = replace(features_over(MOVES), aims=PlaceGrid((-7.0, 4.0), (6.0, 21.0), 4.0))
SCENE = Scene(MOVES, HEADINGS, np.array([-6.0, 4.9]), np.array([5.0, 20.7]))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("walkers")
    write_walkers(directory)
    return directory


@pytest.fixture(scope="module")
def walkers(data: Path) -> Import:
    return imported(read_pedestrians(data))


@pytest.fixture(scope="module")
def training(walkers: Import) -> list[Pair]:
    return [pair for of in walkers.learned.values() for pair in pairs(of)]


def told(of: list[Pair]) -> Training:
    situations, chosen, _ = decisions([pair.walk for pair in of], MOVES, HEADINGS)
    return Training(situations, chosen)


def test_cells_fill_the_disc() -> None:
    assert np.exp(MOVES.log_shares).sum() == pytest.approx(1.0)
    assert len(MOVES.log_shares) == MOVES.count == 97


def test_deviations_are_in_the_cells_that_are_drawn() -> None:
    rng = np.random.default_rng(1)
    cells, angles = rng.integers(MOVES.count, size=5000), rng.uniform(0, 2 * np.pi, 5000)
    ahead = np.column_stack([np.cos(angles), np.sin(angles)])
    np.testing.assert_array_equal(MOVES.chosen(MOVES.drawn(cells, ahead, rng), ahead), cells)


def test_ways_turn_with_the_walker() -> None:
    ways = MOVES.ways(np.array([[0.0, 1.0]]), np.array([[0.0, 1.0]]))[0]
    first = 1 + 7 * MOVES.rays  # the last ring, straight ahead
    np.testing.assert_allclose(ways[first], [0.0, 1.0 + np.hypot(*MOVES.deviations[first])], atol=1e-12)
    left = first + MOVES.rays // 4
    np.testing.assert_allclose(ways[left], [-np.hypot(*MOVES.deviations[left]), 1.0], atol=1e-12)


def test_nats_are_those_of_the_density() -> None:
    """Constant velocity with wide noise against the disc's uniform density, as scipy integrates it."""
    sigma, radius = 0.6, MOVES.rings[-1]
    density = stats.multivariate_normal([0, 0], sigma**2 * np.eye(2)).pdf
    mass = integrate.quad(lambda r: 2 * np.pi * r * density([r, 0.0]), 0, radius)[0]
    here = Situations(
        *(np.array([value]) for value in (0, [0.0, 9.0], [0.0, 1.0], [0.0, 9.0], [0.0, 1.0], False)),
        np.array([[0.0, 1.0]]),
    )
    for cell in (0, 5, 20, 50, 96):
        expected = np.log(density(MOVES.deviations[cell]) / mass * np.pi * radius**2)
        found = nats(Scored(MOVES, gaussian(MOVES, same_way, sigma)), MOVES, Training(here, np.array([cell])))
        assert found[0] == pytest.approx(expected, abs=0.01)


def test_places_are_told_by_weights_of_sum_one_that_keep_the_mean() -> None:
    grid = PlaceGrid((0.0, 0.0), (4.0, 3.0), 0.5)
    places = np.random.default_rng(2).uniform((0.0, 0.0), (4.0, 3.0), (50, 2))
    corners = list(grid.corners(places))
    np.testing.assert_allclose(sum(weights for _, weights in corners), 1.0)
    np.testing.assert_allclose(sum(weights[:, None] * grid.points[at] for at, weights in corners), places)


def test_nearness_is_of_where_both_will_be() -> None:
    """Two who walk towards each other meet two steps ahead: going straight on is near, aside is not."""
    walk = Walk(np.array([[[0.0, 5.0 + k], [0.0, 9.0 - k]] for k in range(4)]), np.ones((4, 2), np.bool_))
    situations, _, _ = decisions([walk], MOVES, HEADINGS)
    nearness = FEATURES.tables(situations).cost[:, -len(LEVELS) :].toarray().reshape(situations.size, MOVES.count, -1)
    aside = 1 + 6 * MOVES.rays + MOVES.rays // 4
    assert nearness[0, 0, 0] > 0.1
    assert nearness[0, aside, 0] < nearness[0, 0, 0] / 2


def test_expectation_minus_observation_is_the_gradient(training: list[Pair]) -> None:
    situations, chosen, _ = decisions([pair.walk for pair in training[:2]], MOVES, HEADINGS)
    game, rng = StepGame(FEATURES, situations), np.random.default_rng(3)
    omega = rng.normal(size=len(FEATURES.cost_names)) / 10
    theta = rng.normal(size=len(FEATURES.reward_names)) / 10
    shown = Trajectories(np.arange(len(chosen))[:, None], chosen[:, None])

    def loss(weights: np.ndarray) -> float:
        chances = StepPolicy(FEATURES, theta, weights).of_tables(game.tables)
        return -float(chances[np.arange(len(chosen)), chosen].mean())

    visitation = StepExpectation(game)(StepPolicy(FEATURES, theta, omega), rng)
    gradient = game.cost_features.total(visitation) - game.cost_features.total(discounted_visitation(shown, 1.0))
    np.testing.assert_allclose(gradient, central_differences(loss, omega), atol=1e-6)


def test_learners_beat_constant_velocity_on_walkers_who_turn_aside(walkers: Import) -> None:
    walks = {name: [pair.walk for pair in pairs(of)] for name, of in walkers.learned.items()}
    history = Network(FEATURES, walks, walkers.experiment).learn(120)
    held_out, learned = told(pairs(walkers.held_out)), told([p for of in walkers.learned.values() for p in pairs(of)])
    noises = np.geomspace(0.02, 0.5, 30)
    rivals = [nats(Scored(MOVES, gaussian(MOVES, same_way, s)), MOVES, learned).mean() for s in noises]
    rival = Scored(MOVES, gaussian(MOVES, same_way, float(noises[int(np.argmax(rivals))])))
    policies = [StepPolicy(FEATURES, *of[-1]) for of in history.values()]
    ours = [float(nats(policy, MOVES, held_out).mean()) for policy in policies]
    assert min(ours) > float(nats(rival, MOVES, held_out).mean())
    assert policies[0].omega == pytest.approx(policies[1].omega, abs=0.05)
    assert -policies[0].omega[-len(LEVELS) :][:3].sum() > 0  # nearness costs


def test_nobody_is_on_both_sides_of_a_split(training: list[Pair], walkers: Import) -> None:
    for learning, judging in splits(training, 3):
        people = [{person for pair in side for person in pair.people} for side in (learning, judging)]
        assert judging
        assert not people[0] & people[1]
    assert {len(of) for of in shared(training, walkers.experiment).values()} == {len(training) // 2}


def test_constant_velocity_without_deviation_is_exact_for_who_never_turns() -> None:
    steps = np.arange(8.0)
    walk = Walk(np.stack([[[0.1 * t, 5 + t], [2.0, 20 - t]] for t in steps]), np.ones((8, 2), np.bool_))
    away = displacements(constant(0.0), [walk], 3, np.random.default_rng(1))
    np.testing.assert_allclose([away.average, away.final], 0.0, atol=1e-12)


def test_drawn_ways_have_the_chances_of_the_policy(training: list[Pair]) -> None:
    rival = Scored(MOVES, gaussian(MOVES, same_way, 0.1))
    walk = Walk(training[0].walk.places[:3], training[0].walk.seen[:3])
    ways = drawn_by(rival, SCENE)(walk, 4000, np.random.default_rng(5))
    deviations = ways[:, 2] - 2 * ways[:, 1] + ways[:, 0]
    assert deviations.std(axis=0) == pytest.approx(np.full((2, 2), 0.1), rel=0.1)


def test_intervals_of_pairs_who_share_people_are_wider() -> None:
    walk = Walk(np.zeros((3, 2, 2)), np.ones((3, 2), np.bool_))
    own = [Pair(walk, (f"a{k}", f"b{k}"), 0.0, 1.0) for k in range(40)]
    common = [Pair(walk, (f"a{k % 4}", f"b{k}"), 0.0, 1.0) for k in range(40)]
    values = np.arange(40) % 4 * 1.0
    widths = [np.ptp(weighted_estimate(values, pigeonhole_weights(of, 1))[1:]) for of in (own, common)]
    assert widths[1] > 1.5 * widths[0]


def test_distances_to_walls() -> None:
    wall = np.array([[0.0, 0.0, 2.0, 0.0]])
    assert distances(np.array([[1.0, 0.5], [3.0, 0.0], [-3.0, 4.0]]), wall) == pytest.approx([0.5, 1.0, 5.0])


def test_the_command(data: Path, tmp_path: Path) -> None:
    options = ("--iterations", "40", "--folds", "2", "--samples", "3", "--out", "report")
    content = printed(tmp_path, "pedestrians", "--data", str(data), *options)
    rows = {row["forecast"]: row for row in content["results"]}
    assert rows["uniform"]["nats"]["mean"] == pytest.approx(0.0, abs=1e-12)
    assert rows["learners, mean"]["nats"]["mean"] > rows["straight to the goal"]["nats"]["mean"]
    assert rows["learner_1"]["average_best"]["mean"] <= rows["learner_1"]["average"]["mean"]
    assert {"costs.png", "settings.png", "report.md", "results.parquet"} <= {
        file.name for file in (tmp_path / "report").iterdir()
    }
    assert len(content["targets"]) == 9


def test_a_directory_without_the_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="give the directory of ucy_zara01"):
        read_pedestrians(tmp_path)
    (tmp_path / "obsmat.txt").write_text("1 2 3\n")
    with pytest.raises(BagError, match="has 3 columns, expected 8"):
        read_pedestrians(tmp_path)
