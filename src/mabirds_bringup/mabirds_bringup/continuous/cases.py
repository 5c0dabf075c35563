"""What the benchmark runs: methods on the same demonstrations by either finder, and variations of MA-BIRDS."""

from collections.abc import Iterator

from mabirds_bringup.bench.cases import Case, method_cases, with_algorithm
from mabirds_core.experiment import Experiment

LATTICE = "lattice"
"""The group of Table 3: policies are found near-exactly."""

SOFT_ACTOR_CRITIC = "soft_actor_critic"
"""The group whose policies are networks that learn."""

VARIATIONS = "variations"
"""The group of MA-BIRDS with other settings."""

NEURAL = {"kind": "neural", "hidden": 32, "bound": 10.0}


def all_cases(main: Experiment, sac: Experiment | None) -> list[Case]:
    """Every case of the benchmark, the table's first. ``sac``: the same experiment by soft actor-critic."""
    lattice = method_cases(LATTICE, main, "bics", "ftl", "dlm", "me_gradient")
    networks = method_cases(SOFT_ACTOR_CRITIC, sac, "bics") if sac else ()
    return [*lattice, *networks, *_variations(main)]


def _variations(main: Experiment) -> Iterator[Case]:
    sides = main.demonstrations.model_copy(update={"side": "random"})
    yield Case(VARIATIONS, "pilots choose sides at random", main.model_copy(update={"demonstrations": sides}))
    yield Case(VARIATIONS, "neural reward, the linear one's steps", with_algorithm(main, reward=NEURAL))
