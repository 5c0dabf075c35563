"""The entry points of the central methods; what they build is loaded with it."""

from typing import TYPE_CHECKING

from mabirds_core.baselines.settings import (
    BicsSettings,
    DlmSettings,
    FtlSettings,
    MeGradientSettings,
    MeGreedySettings,
)
from mabirds_core.errors import ExperimentError
from mabirds_core.registry import Kind

if TYPE_CHECKING:
    from mabirds_core.baselines.bics import Bics
    from mabirds_core.baselines.dlm import Dlm
    from mabirds_core.baselines.ftl import Ftl
    from mabirds_core.baselines.interface import MethodParts
    from mabirds_core.baselines.me_greedy import MeGreedy


def build_bics(settings: BicsSettings, parts: "MethodParts") -> "Bics":  # noqa: ARG001 - there is nothing to set
    """Build the single loop with one central learner.

    Parameters
    ----------
    settings : BicsSettings
        There is nothing to set.
    parts : MethodParts
        Of the experiment.

    Returns
    -------
    Bics
        The method.
    """
    from mabirds_core.baselines.bics import Bics

    return Bics(parts.estimator(parts.reward), parts.steps, parts.memory(parts.reward), parts.seed)


def build_ftl(settings: FtlSettings, parts: "MethodParts") -> "Ftl":
    """Build follow the leader.

    Parameters
    ----------
    settings : FtlSettings
        Of the method.
    parts : MethodParts
        Of the experiment.

    Returns
    -------
    Ftl
        The method.
    """
    from mabirds_core.baselines.ftl import Ftl

    steps = settings.steps or parts.steps
    return Ftl(parts.estimator(parts.reward), steps, settings.tolerance, settings.max_steps, parts.seed)


def build_dlm(settings: DlmSettings, parts: "MethodParts") -> "Dlm":
    """Build the double loop.

    Parameters
    ----------
    settings : DlmSettings
        Of the method.
    parts : MethodParts
        Of the experiment.

    Returns
    -------
    Dlm
        The method.
    """
    from mabirds_core.baselines.dlm import Dlm

    steps, estimator = settings.steps or parts.steps, parts.estimator(parts.reward)
    return Dlm(estimator, steps, settings.window, settings.tolerance, settings.max_steps, parts.seed)


def build_me_greedy(settings: MeGreedySettings, parts: "MethodParts") -> "MeGreedy":
    """Build the inference of constraints by likelihood.

    Parameters
    ----------
    settings : MeGreedySettings
        Of the method.
    parts : MethodParts
        Of the experiment.

    Returns
    -------
    MeGreedy
        The method.

    Raises
    ------
    ExperimentError
        Moves slip, so that no choice keeps a hard constraint for sure, or costs are no weights of features.
    """
    from mabirds_core.baselines.me_greedy import MeGreedy
    from mabirds_core.costs.models import costs_of

    if not costs_of(parts.game).linear:
        raise ExperimentError("method me_greedy: it forbids features, and costs are a network; take me_gradient")
    if not parts.game.transitions.deterministic:
        raise ExperimentError("method me_greedy: moves slip, and hard constraints cannot be kept; take me_gradient")
    return MeGreedy(parts.game, settings.least_mass)


def build_me_gradient(settings: MeGradientSettings, parts: "MethodParts") -> "Bics":
    """Build BICS with nothing to learn but omega.

    Parameters
    ----------
    settings : MeGradientSettings
        Of the method.
    parts : MethodParts
        Of the experiment.

    Returns
    -------
    Bics
        With the true reward.
    """
    from mabirds_core.baselines.bics import Bics

    reward = parts.game.true_reward()
    return Bics(parts.estimator(reward), settings.steps or parts.steps, parts.memory(reward), parts.seed)


BICS = Kind(BicsSettings, build_bics)
FTL = Kind(FtlSettings, build_ftl)
DLM = Kind(DlmSettings, build_dlm)
ME_GREEDY = Kind(MeGreedySettings, build_me_greedy, form="tabular")
ME_GRADIENT = Kind(MeGradientSettings, build_me_gradient)
