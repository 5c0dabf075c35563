"""A case of a benchmark: one way to learn one experiment."""

from dataclasses import dataclass
from typing import Any

from mabirds_core.experiment import Experiment


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


def with_algorithm(experiment: Experiment, **changes: Any) -> Experiment:
    """The experiment with other settings of its algorithm, checked again."""
    content = experiment.model_dump(mode="json")
    content["algorithm"].update(changes)
    return Experiment.model_validate(content)


def shortened(experiment: Experiment, iterations: int) -> Experiment:
    """The experiment with at most so many iterations."""
    return experiment.model_copy(update={"iterations": min(iterations, experiment.iterations)})
