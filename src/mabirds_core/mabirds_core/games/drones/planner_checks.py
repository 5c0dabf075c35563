"""Which planners suit which games of drones."""

import math

from mabirds_core.errors import ExperimentError
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.planner_settings import LatticeSettings, SoftActorCriticSettings
from mabirds_core.planners.settings import check_rollouts

MAX_VALUES = 200_000_000
"""Values that a policy on a lattice may keep, and weights of where actions lead: 1.6 gigabytes each."""

LATTICE_ACTIONS = 25
"""Actions of a drone on a lattice."""


def suits_lattice(game: DroneGame) -> bool:
    """Whether a lattice can plan for the game."""
    return game.n_experts <= 2 and game.settings.dynamics == "single_integrator"


def check_lattice(lattice: LatticeSettings, game: DroneGame) -> None:
    """Check that a lattice suits the game.

    Parameters
    ----------
    lattice : LatticeSettings
        Settings of the planner.
    game : DroneGame
        Of drones.

    Raises
    ------
    ExperimentError
        There are more than two drones, they are no single integrators, or values do not fit into memory.
    """
    settings = game.settings
    if not suits_lattice(game):
        raise ExperimentError(
            f"algorithm.policy lattice: made for one or two single integrators, found {game.n_experts} drones that"
            f" are {settings.dynamics}s; take soft_actor_critic"
        )
    nodes = math.prod(float(count) for count in settings.lattice(lattice.spacing))
    of_states = nodes**game.n_experts * (game.horizon + 2)
    of_actions = (
        nodes * game.n_experts * LATTICE_ACTIONS * math.prod(map(float, settings.stencil_shape(lattice.spacing)))
    )
    if (values := max(of_states, of_actions)) > MAX_VALUES:
        raise ExperimentError(
            f"algorithm.policy.spacing {lattice.spacing:g} m makes {values:.2g} values, expected at most"
            f" {MAX_VALUES:.2g}; take a larger one"
        )


def check_soft_actor_critic(settings: SoftActorCriticSettings, game: DroneGame) -> None:
    """Check that what is rolled out at once fits into memory.

    Parameters
    ----------
    settings : SoftActorCriticSettings
        Of the planner.
    game : DroneGame
        Of drones.

    Raises
    ------
    ExperimentError
        It does not.
    """
    check_rollouts("policy.rollouts", settings.rollouts, game.horizon)
