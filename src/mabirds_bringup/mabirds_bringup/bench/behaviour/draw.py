"""A game, a network and demonstrations, drawn at random from one seed."""

from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from mabirds_core.algorithm.memory import stacked
from mabirds_core.errors import ExperimentError, InfeasibleError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories
from mabirds_core.registry import kinds, require
from mabirds_core.settings import Settings

PER_LEARNER, HELD_OUT = 40, 400
"""Demonstrations of each learner, and those that nobody learns from."""

LEARNERS = (2, 2, 4, 4, 8)
SCHEDULES: tuple[dict[str, Any], ...] = (
    {"kind": "static"},
    {"kind": "static", "graph": "ring"},
    {"kind": "alternating"},
    {"kind": "random_matching", "slots": 40},
)
PAPER_STEPS: dict[str, Any] = {
    "steps": {"kind": "paper", "alpha": 16.0, "beta": 8.0},
    "window": 1,
    "rollout_start": "initial",
    "reward": {"kind": "linear", "lateness": False},
}
"""The paper's rule and reward, with numbers that were chosen on one map."""


class Draw(NamedTuple):
    """One random problem.

    Attributes
    ----------
    seed : int
        Of all that is random in it.
    experiment : Experiment
        With the default rule.
    streams : dict
        Each learner's demonstrations.
    held_out : Trajectories
        Drawn after them.
    """

    seed: int
    experiment: Experiment
    streams: dict[str, list[Trajectories]]
    held_out: Trajectories

    @property
    def pooled(self) -> Trajectories:
        """All learners' demonstrations."""
        return stacked([demonstration for stream in self.streams.values() for demonstration in stream])


def random_kind(name: str) -> str:
    """Kind of game ``name``, or the first that can be drawn; raises ExperimentError where it cannot be."""
    able = [kind for kind, offered in kinds("mabirds.games").items() if offered.sample]
    if not able or name not in {"", *able}:
        raise ExperimentError(f"game {name!r}: expected one that can be drawn at random, one of {able}")
    return name or able[0]


def draw(seed: int, game_kind: str, demonstrations: int = PER_LEARNER) -> Draw:
    """Draw games until experts can walk one; ``demonstrations``: of each learner."""
    rng = np.random.default_rng([seed, 7])
    while True:
        experiment = _experiment(seed, rng, game_kind, demonstrations)
        game = build_game(experiment)
        try:
            stream = game.experts("soft", "by_start").demonstrations(10**9, rng)
            streams = {name: list(islice(stream, demonstrations)) for name in experiment.learners}
        except InfeasibleError:
            continue  # experts cannot pass each other in time
        return Draw(seed, experiment, streams, stacked(list(islice(stream, HELD_OUT))))


def _experiment(seed: int, rng: np.random.Generator, game_kind: str, demonstrations: int) -> Experiment:
    sample = require("mabirds.games", game_kind).sample or _cannot
    settings: Any = sample(rng)
    count = int(rng.choice(LEARNERS)) if settings.n_experts <= 2 else 2
    return Experiment.model_validate(
        {
            "name": f"{game_kind}-{seed}",
            "game": settings,
            "learners": [f"learner_{number}" for number in range(1, count + 1)],
            "schedule": SCHEDULES[int(rng.integers(len(SCHEDULES)))],
            "demonstrations": {"bag": "none", "per_learner": demonstrations, "experts": "soft"},
            "iterations": demonstrations,
            "seed": seed,
        }
    )


def _cannot(rng: np.random.Generator) -> Settings:  # noqa: ARG001 - nothing is drawn
    raise ExperimentError("this kind of game cannot be drawn at random")


def with_paper_steps(experiment: Experiment) -> Experiment:
    """The same with the paper's rule."""
    return Experiment.model_validate({**experiment.model_dump(), "algorithm": PAPER_STEPS})
