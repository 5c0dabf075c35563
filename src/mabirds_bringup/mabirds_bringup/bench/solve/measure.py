"""One case in a process of its own: times, memory, and agreement with the reference."""

import itertools
import resource
from pathlib import Path
from time import process_time

import numpy as np

import mabirds_bringup
from mabirds_bringup.bench.solve.cases import MOST_UPDATES, SolveCase, weights
from mabirds_bringup.bench.solve.peer import of_states, peer_solve
from mabirds_bringup.bench.solve.solving import fastest, solve
from mabirds_core.arrays import Vector
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.factored import FactoredGame
from mabirds_core.planners.occupancy import discounted_steps, occupancy_measure, pairs_of
from mabirds_core.planners.soft_bellman import soft_bellman_policy
from mabirds_expert_player.recorder import expert_streams

BYTES = 40
"""A state and step: five numbers that a solve reads or writes at the least."""

COPIED = 2**23
"""Numbers in the copy that measures bandwidth: 64 megabytes, more than caches hold."""


def reference(game: FactoredGame, theta: Vector, omega: Vector) -> tuple[Vector, Vector]:
    """The same by tables of all joint actions."""
    table = game.reward_features.table(theta) + game.cost_features.table(omega)
    occupancy = occupancy_measure(game, soft_bellman_policy(game, table))
    visitation = pairs_of(discounted_steps(game) * occupancy)
    return game.reward_features.total(visitation), game.cost_features.total(visitation)


def bandwidth_limit(game: FactoredGame) -> float:
    """Milliseconds that it takes to copy BYTES a state and step to another place in memory."""
    source = np.ones(COPIED)
    target = np.zeros(COPIED)
    per_byte = fastest(lambda: np.copyto(target, source)) / source.nbytes
    return per_byte * BYTES * game.n_states * (game.horizon + 1)


def megabytes() -> float:
    """The most memory that this process ever had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def measure(case: SolveCase) -> dict[str, float]:
    """Solve a case.

    Parameters
    ----------
    case : SolveCase
        Which game.

    Returns
    -------
    dict[str, float]
        Milliseconds and megabytes, and those of the reference and the peer where asked for.
    """
    game = case.game
    asked = (game, *weights(game))
    ours = solve(*asked)
    measured = {"milliseconds": fastest(lambda: solve(*asked)), "megabytes": megabytes()}
    limit = bandwidth_limit(game)
    measured |= {"bandwidth_limit": limit, "times_of_bandwidth_limit": measured["milliseconds"] / limit}
    if case.reference:
        measured |= _beside("reference", reference(*asked), ours)
        measured["reference_milliseconds"] = fastest(lambda: reference(*asked))
        measured["share_of_reference"] = measured["milliseconds"] / measured["reference_milliseconds"]
    if case.peer:
        measured |= beside_peer(game, *of_states(*asked))
    return measured


def beside_peer(game: FactoredGame, theta: Vector, omega: Vector) -> dict[str, float]:
    """What the peer takes, and how far its results are from ours; nothing where it is not installed.

    Parameters
    ----------
    game : FactoredGame
        A small one.
    theta : Vector
        As ``peer.of_states`` gives it.
    omega : Vector
        As ``peer.of_states`` gives it.

    Returns
    -------
    dict[str, float]
        Milliseconds and differences.
    """
    peer = peer_solve(game, theta, omega)
    if peer is None:
        return {}
    times = {"peer_milliseconds": fastest(peer), "beside_peer_milliseconds": fastest(lambda: solve(game, theta, omega))}
    share = times["beside_peer_milliseconds"] / times["peer_milliseconds"]
    return _beside("peer", peer(), solve(game, theta, omega)) | times | {"share_of_peer": share}


def _beside(name: str, theirs: tuple[Vector, Vector], ours: tuple[Vector, Vector]) -> dict[str, float]:
    """Largest difference of the features' totals."""
    return {f"{name}_difference": max(float(np.abs(a - b).max()) for a, b in zip(theirs, ours, strict=True))}


def iteration(name: str) -> dict[str, float]:
    """A learner's iteration in a shipped experiment, without ROS.

    Parameters
    ----------
    name : str
        Of its file, such as "ros_ws/config/discrete.yaml".

    Returns
    -------
    dict[str, float]
        Median milliseconds of processor time.
    """
    file = Path(mabirds_bringup.__file__).parent / "config" / Path(name).name
    experiment, times = load_experiment(file), list[float]()
    iterations = min(experiment.iterations, MOST_UPDATES // len(experiment.learners))
    experiment = experiment.model_copy(update={"iterations": iterations})
    streams = expert_streams(experiment, build_game(experiment))
    shown = {learner: list(itertools.islice(stream, iterations)) for learner, stream in streams.items()}
    simulate(experiment, shown, lambda _: times.append(process_time()))
    return {"milliseconds": 1e3 * float(np.median(np.diff(times)))}
