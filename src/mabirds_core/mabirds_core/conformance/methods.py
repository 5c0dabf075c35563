"""Checks of central methods and mixers."""

from collections.abc import Iterable

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.baselines.interface import CentralMethod
from mabirds_core.conformance.expectations import (
    demonstrations,
    require,
)
from mabirds_core.consensus.generators import complete_edges, static
from mabirds_core.consensus.mixer import AnyMixer
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.games.whole_game import Game


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
    shown = demonstrations(game, seed)
    results = []
    for _ in range(2):
        state = method.initial_state()
        require(state.iteration == 1, f"initial_state: iteration {state.iteration}, expected 1")
        sizes = [values.shape for values in state.parameters]
        for n, demonstration in enumerate(shown, start=1):
            before, state = state, method.update(state, demonstration)
            require(state.iteration == n + 1, f"update: iteration {state.iteration}, expected {n + 1}")
            require(
                [values.shape for values in state.parameters] == sizes, "update: expected the shapes of theta, omega"
            )
            require(all(np.isfinite(values).all() for values in state.parameters), "update: expected finite numbers")
            require(min(np.subtract(state.work, before.work)) >= 0, "update: expected work that never shrinks")
        results.append(state.parameters)
    same = all(np.array_equal(*pair) for pair in zip(*results, strict=True))
    require(same, "update: expected the same parameters from the same demonstrations")


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
            require(same, f"{name}: from_arrays(to_arrays(state)) has other parameters")
            states[name] = restored
    for name, state in states.items():
        near = all(np.allclose(*pair, atol=1e-6) for pair in zip(state.parameters, mean, strict=True))
        require(near, f"{name}: expected the mean of all learners' parameters after many rounds")


def complete_schedule(learners: tuple[str, ...]) -> EdgeSchedule:
    """Everybody talks to everybody at every iteration."""
    return static(learners, complete_edges(len(learners)))
