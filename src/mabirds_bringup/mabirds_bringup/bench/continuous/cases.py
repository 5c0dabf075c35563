"""What the benchmark runs: methods on the same demonstrations by either planner, and variations of MA-BIRDS."""

from collections.abc import Iterator

from mabirds_bringup.bench.cases import Case, method_cases, with_algorithm
from mabirds_core.experiment.file import Experiment, PassingSide

LATTICE = "lattice"
"""The group of Table 3: policies are found near-exactly."""

SOFT_ACTOR_CRITIC = "soft_actor_critic"
"""The group whose policies are networks that learn."""

VARIATIONS = "variations"
"""The group of MA-BIRDS with other settings."""

NEURAL = {"kind": "neural", "hidden": 32, "bound": 10.0}
NEURAL_STEPS = {"alpha": 20.0, "beta": 0.1, "eta1": 0.8, "eta2": 0.65}
"""A step of theta changes a network's reward far more than a linear one's."""


def all_cases(main: Experiment, sac: Experiment | None) -> list[Case]:
    """Every case of the benchmark, the table's first. ``sac``: the same experiment by soft actor-critic."""
    lattice = method_cases(LATTICE, main, "bics", "ftl", "dlm", "me_gradient")
    networks = method_cases(SOFT_ACTOR_CRITIC, sac, "bics") if sac else ()
    return [*lattice, *networks, *_variations(main, sac)]


def _variations(main: Experiment, sac: Experiment | None) -> Iterator[Case]:
    yield Case(VARIATIONS, "sides at random", _passing(main, "random"))
    yield Case(VARIATIONS, "all pass on the right", _passing(main, "right"))
    yield Case(VARIATIONS, "neural reward", with_algorithm(main, reward=NEURAL, steps=NEURAL_STEPS))
    if sac:
        by_start = _passing(sac, "by_start")
        yield Case(VARIATIONS, "BICS by soft actor-critic, sides by start", by_start, "bics")


def _passing(experiment: Experiment, side: PassingSide) -> Experiment:
    return experiment.model_copy(update={"demonstrations": experiment.demonstrations.model_copy(update={"side": side})})
