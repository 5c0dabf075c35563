"""What the benchmark runs: methods on the same demonstrations, and variations of MA-BIRDS."""

from collections.abc import Iterator

from mabirds_bringup.bench.cases import Case, method_cases, with_algorithm
from mabirds_core.experiment.file import Experiment

MAIN = "main"
"""The group of Tables 1 and 2."""

VARIATIONS = "variations"
"""The group of MA-BIRDS with other settings."""

HARD = "hard"
"""The group of the game with many starts."""

AS_WRITTEN = "rollouts from the demonstrations' starts"
"""The case of many starts that is as its experiment is written."""

METHODS = ("bics", "ftl", "dlm", "me_greedy")


def all_cases(main: Experiment, hard: Experiment) -> list[Case]:
    """Every case of the benchmark, the tables' first."""
    return [*method_cases(MAIN, main, *METHODS), *_variations(main), *_hard_cases(hard)]


def _variations(main: Experiment) -> Iterator[Case]:
    other = "sampled" if main.algorithm.expectation == "exact" else "exact"
    yield Case(VARIATIONS, f"{other} expectations", with_algorithm(main, expectation=other))
    for count in (2, 4, 8):
        yield Case(VARIATIONS, f"{count} learners on an alternating ring", _on_alternating_ring(main, count))
    neural = {"kind": "neural", "hidden": 32, "bound": 10.0}
    yield Case(VARIATIONS, "neural reward", with_algorithm(main, reward=neural))
    yield Case(VARIATIONS, "soft Q-learning", with_algorithm(main, policy={"kind": "soft_q_learning"}))


def _hard_cases(hard: Experiment) -> Iterator[Case]:
    for start, label in (("demonstration", AS_WRITTEN), ("initial", "rollouts from P_0")):
        yield Case(HARD, label, with_algorithm(hard, rollout_start=start))


def _on_alternating_ring(experiment: Experiment, count: int) -> Experiment:
    content = experiment.model_dump(mode="json")
    content["schedule"] = {"kind": "alternating"}
    content["closing_rounds"] = 2 * count  # news take so long around the ring
    content["learners"] = [f"learner_{number}" for number in range(1, count + 1)]
    return Experiment.model_validate(content)
