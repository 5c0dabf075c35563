"""The entry points of the step rules: each is its own settings."""

from mabirds_core.algorithm.adaptive_steps import AdaptiveSteps
from mabirds_core.algorithm.paper_steps import PaperSteps
from mabirds_core.registry import Kind


def build_adaptive(settings: AdaptiveSteps) -> AdaptiveSteps:
    """The rule that needs no numbers."""
    return settings


def build_paper(settings: PaperSteps) -> PaperSteps:
    """The paper's rule."""
    return settings


ADAPTIVE = Kind(AdaptiveSteps, build_adaptive)
PAPER = Kind(PaperSteps, build_paper, default=True)
