"""Checks for games, rewards, planners, methods and mixers from anywhere: what Algorithm 1 takes for granted of them.

Run them in the tests of your own package, on small instances:

    from mabirds_core import conformance
    def test_my_game(): conformance.check_game(MyGame(settings))

Each raises AssertionError that says what is expected of whom. They are slow and obvious on purpose.
"""

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.baselines.interface import CentralMethod
from mabirds_core.consensus.generators import complete_edges, static
from mabirds_core.consensus.mixer import AnyMixer
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.costs.models import CostModel
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.games.interface import FeatureMap, Trajectories, Visitation, discounted_visitation
from mabirds_core.games.whole_game import Game
from mabirds_core.planners.interface import Planner, Policy, TabularPolicy
from mabirds_core.registry import Kind
from mabirds_core.rewards.models import RewardModel
from mabirds_core.settings import Settings

DEMONSTRATIONS = 5
"""Drawn of a game's experts."""

STEP = 1e-5
"""Step of finite differences."""


def check_settings(kind: Kind, content: dict[str, object]) -> Settings:
    """Check that settings are read, refused where misspelt, and cannot be changed.

    Parameters
    ----------
    kind : Kind
        With the settings' model.
    content : dict[str, object]
        As of an experiment file.

    Returns
    -------
    Settings
        The settings of ``content``.
    """
    model = kind.settings
    settings = model.model_validate(content)
    again = model.model_validate_json(settings.model_dump_json())
    _require(again == settings, f"{model.__name__}: written as JSON and read again, it is another")
    _require(_fails(lambda: model.model_validate({**content, "mispelt": 1})), f"{model.__name__} takes unknown names")
    name = next(iter(model.model_fields))
    _require(_fails(lambda: setattr(settings, name, None)), f"{model.__name__} can be changed")
    return settings


def check_game(game: Game, seed: int = 0) -> None:
    """Check encoding, refusals, features, constraints and experts of a game that has experts.

    Parameters
    ----------
    game : Game
        A small one.
    seed : int, optional
        Of demonstrations.
    """
    _require(game.horizon >= 1, f"horizon {game.horizon}: expected at least 1")
    _require(0 < game.discount <= 1, f"discount {game.discount}: expected in (0, 1]")
    _require(game.digest == game.digest != "", "digest: expected the same text each time")
    names, truth = game.cost_features.names, game.true_constraints
    constraints = np.zeros(len(names), dtype=np.bool_) if truth is None else truth
    _require(len(set(names)) == len(names), "cost_features.names: expected all different")
    _require(constraints.shape == (len(names),), f"true_constraints: shape {constraints.shape}, expected {len(names)}")
    for kind in game.expert_kinds:
        for demonstration in game.experts(kind, "by_start").demonstrations(DEMONSTRATIONS, np.random.default_rng(seed)):
            _check_encoding(game, demonstration)
            _check_refusals(game, demonstration)
            _check_features(game.cost_features, discounted_visitation(demonstration, game.discount))
            _check_measures(game, demonstration, seed)
    for reward in (game.linear_reward(), *(() if truth is None else (game.true_reward(),))):
        check_reward(reward, game, seed)


def _check_encoding(game: Game, trajectory: Trajectories) -> None:
    states, actions = game.encode(trajectory)
    for name, values in (("states", states), ("actions", actions)):
        expected = f"encode: {name} of shape {values.shape}, expected {game.horizon + 1} rows of finite numbers"
        _require(values.ndim == 2 and len(values) == game.horizon + 1 and bool(np.isfinite(values).all()), expected)
    again = game.decode(states, actions)
    same = all(np.array_equal(*pair) for pair in zip(again, trajectory, strict=True))
    _require(same, "decode(encode(trajectory)) is another trajectory")


def _check_refusals(game: Game, trajectory: Trajectories) -> None:
    """What is no trajectory of the game is refused with the right error, whatever it is."""
    states, actions = game.encode(trajectory)
    wrong: dict[str, tuple[Array, Array]] = {
        "too short": (states[:1], actions[:1]),
        "too many columns": (np.column_stack([states, states]), actions),
        "not finite": (np.full_like(states, np.nan), actions),
        "out of all bounds": (states + 1e6, actions),
        "one step of which leads elsewhere": (_displaced(states), actions),
    }
    for what, arrays in wrong.items():
        refused = _fails(lambda arrays=arrays: game.decode(*arrays), ImpossibleTrajectoryError)  # type: ignore[misc]
        _require(refused, f"decode takes a trajectory that is {what}; expected ImpossibleTrajectoryError")


def _check_measures(game: Game, demonstration: Trajectories, seed: int) -> None:
    omega = np.random.default_rng(seed).normal(size=len(game.cost_features.names))
    for measure, values in game.measures(omega, demonstration).items():
        _require(measure.isidentifier(), f"measures: {measure!r}, expected a name such as obstacle_cost")
        finite = all(np.isfinite(value) for value in values.values())
        _require(finite, f"measures: {measure} is not finite, expected a number for each thing that it measures")


def _displaced(states: Array) -> Array:
    """The states with the last row where the first one was, or elsewhere where nothing has moved."""
    moved = states.copy()
    moved[-1] = states[0] if not np.array_equal(states[0], states[-1]) else states[-1] - 1
    return moved


def _check_features(features: FeatureMap, visitation: Visitation) -> None:
    total = features.total(visitation)
    _require(total.shape == (len(features.names),), f"total: shape {total.shape}, expected {len(features.names)}")
    parts = (Visitation(*(values[[k]] for values in visitation)) for k in range(len(visitation.weights)))
    summed = sum((features.total(part) for part in parts), np.zeros(len(features.names)))
    _require(np.allclose(total, summed), "total of a visitation: expected the sum of the totals of its pairs")
    twice = features.total(visitation._replace(weights=2 * visitation.weights))
    _require(np.allclose(2 * total, twice), "total: expected twice as much for weights twice as large")
    fitting = not getattr(features, "nonnegative", False) or bool((total >= 0).all())
    _require(fitting, "total: expected none below 0 of features that say nonnegative = True")
    table = getattr(features, "table", None)
    if table is not None:
        weights = np.random.default_rng(0).normal(size=len(features.names))
        by_table = float(visitation.weights @ table(weights)[visitation.states, visitation.actions])
        _require(bool(np.isclose(by_table, weights @ total)), "table and total of the features disagree")


def check_reward(model: RewardModel, game: Game, seed: int = 0) -> None:
    """Check shapes, and for tables the gradient against finite differences.

    Parameters
    ----------
    model : RewardModel
        r_theta.
    game : Game
        A small one that it fits.
    seed : int, optional
        Of theta and demonstrations.
    """
    rng = np.random.default_rng(seed)
    theta = model.initial(rng)
    _require(theta.shape == (model.size,), f"initial: shape {theta.shape}, expected ({model.size},)")
    first, second = (model.initial(np.random.default_rng(3)) for _ in range(2))
    _require(np.array_equal(first, second), "initial: expected the same theta(1) from the same seed")
    for visitation in _visitations(game, seed):
        theta = rng.normal(size=model.size)
        gradient = model.gradient(theta, visitation)
        _require(gradient.shape == (model.size,), f"gradient: shape {gradient.shape}, expected ({model.size},)")
        table = getattr(model, "table", None)
        if table is not None:
            differences = _differences(partial(_by_table, table, visitation), theta)
            _require(np.allclose(gradient, differences, atol=1e-4), "gradient: expected that of the reward's table")


def check_costs(model: CostModel, game: Game, seed: int = 0) -> None:
    """Check shapes, gradients against finite differences of the table, and totals.

    Parameters
    ----------
    model : CostModel
        -c_omega.
    game : Game
        A small tabular one that it fits.
    seed : int, optional
        Of omega and demonstrations.
    """
    rng, features = np.random.default_rng(seed), len(game.cost_features.names)
    first, second = (model.initial(np.random.default_rng(3)) for _ in range(2))
    _require(first.shape == (model.size,), f"initial: shape {first.shape}, expected ({model.size},)")
    _require(np.array_equal(first, second), "initial: expected the same omega(1) from the same seed")
    _require(len(model.names) in {0, model.size}, f"names: {len(model.names)}, expected none or {model.size}")
    for visitation in _visitations(game, seed):
        omega, total = rng.normal(size=model.size), model.total(visitation)
        _require(total.shape == (model.total_size,), f"total: shape {total.shape}, expected ({model.total_size},)")
        same = np.array_equal(total[:features], game.cost_features.total(visitation))
        _require(same, "total: expected the totals of the game's cost features first")
        differences = _differences(partial(_by_table, model.table, visitation), omega)
        close = np.allclose(model.gradient_of_total(omega, total), differences, atol=1e-4)
        _require(close, "gradient_of_total: expected that of the table")
        weights = model.by_feature(omega)
        _require(weights.shape == (features,), f"by_feature: shape {weights.shape}, expected ({features},)")
        _require(model.penalty_gradient(omega).shape == omega.shape, f"penalty_gradient: expected shape {omega.shape}")


def check_planner(planner: Planner, game: Game, reward: RewardModel, seed: int = 0) -> None:
    """Check for the same policy from the same arguments, probabilities, and a memory that serves as the policy did.

    Parameters
    ----------
    planner : Planner
        Of the game and the reward.
    game : Game
        A small one.
    reward : RewardModel
        r_theta.
    seed : int, optional
        Of theta and omega.
    """
    rng = np.random.default_rng(seed)
    theta, omega = rng.normal(size=reward.size), rng.normal(size=len(game.cost_features.names))
    first, second = (planner.plan(theta, omega, rng=np.random.default_rng(1)) for _ in range(2))
    same = np.array_equal(_followed(game, first), _followed(game, second))
    _require(same, "find: expected the same policy from the same arguments")
    if hasattr(first, "log_probabilities"):
        _check_probabilities(first, game)
    memory = planner.state_dict(first)
    recalled = planner.load_state_dict(memory) if memory else None
    kept, resumed = (planner.plan(theta, omega, before, np.random.default_rng(4)) for before in (first, recalled))
    same = np.array_equal(_followed(game, kept), _followed(game, resumed))
    _require(same, "load_state_dict(state_dict(policy)): expected it to serve a search as the policy does")


def _followed(game: Game, policy: Policy) -> Vector:
    """Totals of the cost features over what a policy does, shape (K,)."""
    visits = game.expectation(game.expectations[0], 50)(policy, np.random.default_rng(2))
    steps = sum(game.discount**step for step in range(game.horizon + 1))
    _require(bool(np.isclose(visits.weights.sum(), steps)), "expectation: expected weights of T + 1 discounted steps")
    return game.cost_features.total(visits)


def _check_probabilities(policy: TabularPolicy, game: Game) -> None:
    visits = game.expectation(game.expectations[0], 50)(policy, np.random.default_rng(2))
    for step in (0, game.horizon):
        sums = np.exp(policy.log_probabilities(step, np.unique(visits.states))).sum(axis=1)
        _require(np.allclose(sums[sums > 0], 1), "log_probabilities: expected probabilities that sum to 1")


def check_method(method: CentralMethod, game: Game, seed: int = 0) -> None:
    """Check iterations, shapes and work of a central method, and that it gives the same result again.

    Parameters
    ----------
    method : CentralMethod
        For the game.
    game : Game
        A small one.
    seed : int, optional
        Of demonstrations.
    """
    shown = _demonstrations(game, seed)
    results = []
    for _ in range(2):
        state = method.initial_state()
        _require(state.iteration == 1, f"initial_state: iteration {state.iteration}, expected 1")
        sizes = [values.shape for values in state.parameters]
        for n, demonstration in enumerate(shown, start=1):
            before, state = state, method.update(state, demonstration)
            _require(state.iteration == n + 1, f"update: iteration {state.iteration}, expected {n + 1}")
            _require(
                [values.shape for values in state.parameters] == sizes, "update: expected the shapes of theta, omega"
            )
            _require(all(np.isfinite(values).all() for values in state.parameters), "update: expected finite numbers")
            _require(min(np.subtract(state.work, before.work)) >= 0, "update: expected work that never shrinks")
        results.append(state.parameters)
    same = all(np.array_equal(*pair) for pair in zip(*results, strict=True))
    _require(same, "update: expected the same parameters from the same demonstrations")


def check_mixers(mixers: Iterable[AnyMixer]) -> None:
    """Check that the mean stays, learners come together, and checkpoints lose nothing.

    Parameters
    ----------
    mixers : Iterable[AnyMixer]
        Of all learners of one schedule.

    Examples
    --------
    >>> from mabirds_core.consensus.strict import StrictMixer
    >>> schedule = complete_schedule(("ann", "bob", "cid"))
    >>> check_mixers(StrictMixer(name, schedule) for name in schedule.learners)
    """
    by_name = {mixer.name: mixer for mixer in mixers}
    rng = np.random.default_rng(0)
    start = {name: Parameters(rng.normal(size=3), rng.normal(size=2)) for name in by_name}
    states = {name: mixer.initial(start[name]) for name, mixer in by_name.items()}
    mean = [np.mean(values, axis=0) for values in zip(*start.values(), strict=True)]
    for n in range(1, 40):
        sent = {name: mixer.outgoing(states[name], n) for name, mixer in by_name.items()}
        for name, mixer in by_name.items():
            messages = {sender: receivers[name] for sender, receivers in sent.items() if name in receivers}
            states[name] = mixer.mix(mixer.incoming(states[name], n, messages), n, None)
        for name, mixer in by_name.items():
            restored = mixer.from_arrays(states[name].parameters, mixer.to_arrays(states[name]))
            same = all(np.array_equal(*pair) for pair in zip(restored.parameters, states[name].parameters, strict=True))
            _require(same, f"{name}: from_arrays(to_arrays(state)) has other parameters")
            states[name] = restored
    for name, state in states.items():
        near = all(np.allclose(*pair, atol=1e-6) for pair in zip(state.parameters, mean, strict=True))
        _require(near, f"{name}: expected the mean of all learners' parameters after many rounds")


def complete_schedule(learners: tuple[str, ...]) -> EdgeSchedule:
    """Everybody talks to everybody at every iteration."""
    return static(learners, complete_edges(len(learners)))


def _visitations(game: Game, seed: int) -> list[Visitation]:
    return [discounted_visitation(shown, game.discount) for shown in _demonstrations(game, seed)]


def _demonstrations(game: Game, seed: int) -> list[Trajectories]:
    if not game.expert_kinds:
        return []
    experts = game.experts(game.expert_kinds[0], "by_start")
    return list(experts.demonstrations(DEMONSTRATIONS, np.random.default_rng(seed)))


def _by_table(table: Callable[[Vector], Array], visitation: Visitation, theta: Vector) -> float:
    """sum_k weights[k] r_theta(states[k], actions[k])."""
    return float(visitation.weights @ table(theta)[visitation.states, visitation.actions])


def _differences(function: Callable[[Vector], float], at: Vector) -> Vector:
    """Central finite differences of a function of a vector."""
    units = STEP * np.eye(len(at))
    return np.array([(function(at + unit) - function(at - unit)) / (2 * STEP) for unit in units])


def _fails(call: Callable[[], object], error: type[Exception] = Exception) -> bool:
    try:
        call()
    except error:
        return True
    return False


def _require(condition: bool, expectation: str) -> None:  # noqa: FBT001 - a condition, as of assert
    if not condition:
        raise AssertionError(expectation)
