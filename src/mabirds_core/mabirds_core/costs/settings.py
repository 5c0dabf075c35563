"""Cost models as written in an experiment file."""

from typing import Any, Literal

from pydantic import Field

from mabirds_core.errors import ExperimentError
from mabirds_core.settings import Settings

MAX_WORK = 100_000_000
"""Joint states times inputs times hidden units: some gigabytes."""


class LinearCostSettings(Settings):
    """-c_omega = omega^T phi."""

    kind: Literal["linear"] = "linear"


class NetworkCostSettings(Settings):
    """c_omega of a small network, between 0 and bound."""

    kind: Literal["network"]
    width: int = Field(8, ge=1, le=1000, description="units of the hidden layer")
    bound: float = Field(10.0, gt=0, le=1000, description="C: no joint state costs more")
    apart: float = Field(
        1.0, ge=0, le=1e6, description="weight of the penalty on what the reward can say as well; 0: no penalty"
    )
    beside_features: bool = Field(
        False, description="weights of the game's cost features beside it, which say what single cells cost"
    )
    inputs: tuple[str, ...] | None = Field(
        None, min_length=1, max_length=100, description="what the network sees of a joint state; default: all there is"
    )


def check_network(settings: NetworkCostSettings, game: Any) -> None:
    """Check that the game tells networks of its joint states, and what the settings ask for.

    Parameters
    ----------
    settings : NetworkCostSettings
        Of the cost.
    game : Any
        Of the experiment.

    Raises
    ------
    ExperimentError
        It does not, or the network is too large.
    """
    if not hasattr(game, "cost_inputs"):
        raise ExperimentError("algorithm.cost network: this game tells networks nothing of its states; take linear")
    known = game.cost_inputs(None).names
    unknown = sorted(set(settings.inputs or ()) - set(known))
    if unknown:
        raise ExperimentError(f"algorithm.cost.inputs {unknown}: this game has {list(known)}; take some of them")
    work = game.n_states * len(settings.inputs or known) * settings.width
    if work > MAX_WORK:
        raise ExperimentError(
            f"algorithm.cost: {game.n_states} joint states, {len(settings.inputs or known)} inputs and width"
            f" {settings.width} make {work:.2g} numbers, expected at most {MAX_WORK:.2g}; take fewer inputs or units"
        )
