"""The entry point of the paper's step rule."""

from mabirds_core.algorithm.parameters import StepSizes
from mabirds_core.registry import Kind


def build_step_sizes(settings: StepSizes) -> StepSizes:
    """The settings are the rule."""
    return settings


PAPER = Kind(StepSizes, build_step_sizes, default=True)
