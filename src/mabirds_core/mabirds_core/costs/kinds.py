"""The entry points of the cost models that come along."""

from typing import TYPE_CHECKING, Any

from mabirds_core.costs.models import LinearCost
from mabirds_core.costs.settings import LinearCostSettings, NetworkCostSettings, check_network
from mabirds_core.registry import Kind

if TYPE_CHECKING:
    from mabirds_core.costs.network import NetworkCost


def build_linear(settings: LinearCostSettings, game: Any) -> LinearCost:  # noqa: ARG001 - there is nothing to set
    """Build omega^T phi.

    Parameters
    ----------
    settings : LinearCostSettings
        There is nothing to set.
    game : Any
        With cost features.

    Returns
    -------
    LinearCost
        -c_omega.
    """
    return LinearCost(game.cost_features)


def build_network(settings: NetworkCostSettings, game: Any) -> "NetworkCost":
    """Build a network.

    Parameters
    ----------
    settings : NetworkCostSettings
        Of the network.
    game : Any
        With inputs.

    Returns
    -------
    NetworkCost
        c_omega.
    """
    from mabirds_core.costs.network import NetworkCost

    inputs = game.cost_inputs(settings.inputs)
    return NetworkCost(
        game.cost_features, inputs, settings.width, settings.bound, settings.apart, settings.beside_features
    )


LINEAR = Kind(LinearCostSettings, build_linear, default=True)
NETWORK = Kind(NetworkCostSettings, build_network, check=check_network)
