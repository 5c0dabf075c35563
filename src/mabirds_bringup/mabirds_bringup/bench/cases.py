"""A case of a benchmark: one way to learn one experiment."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from mabirds_core.experiment.file import Experiment

MABIRDS = "MA-BIRDS"
"""The label of the network of learners."""

METHOD_LABELS = {
    "bics": "BICS",
    "ftl": "FTL",
    "dlm": "DLM",
    "me_greedy": "ME-greedy",
    "me_gradient": "ME-gradient",
}
"""The labels of central methods."""


@dataclass(frozen=True)
class Case:
    """One way to learn one experiment. ``method``: a central method; None: the network of learners."""

    group: str
    label: str
    experiment: Experiment
    method: str | None = None

    def seeded(self, seed: int) -> Experiment:
        """The experiment with demonstrations and rollouts of their own."""
        demonstrations = self.experiment.demonstrations.model_copy(update={"seed": seed})
        return self.experiment.model_copy(update={"seed": seed, "demonstrations": demonstrations})


def method_cases(group: str, experiment: Experiment, *methods: str) -> Iterator[Case]:
    """MA-BIRDS and central methods on the same demonstrations."""
    yield Case(group, MABIRDS, experiment)
    for method in methods:
        yield Case(group, METHOD_LABELS[method], experiment, method)


def with_algorithm(experiment: Experiment, **changes: Any) -> Experiment:
    """The experiment with other settings of its algorithm, checked again."""
    content = experiment.model_dump(mode="json")
    content["algorithm"].update(changes)
    return Experiment.model_validate(content)


def truncate(experiment: Experiment, iterations: int) -> Experiment:
    """The experiment with at most so many iterations."""
    return experiment.model_copy(update={"iterations": min(iterations, experiment.iterations)})
