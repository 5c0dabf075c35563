"""The entry points of the drone game and of the planners that are made for it; what they build is loaded with it."""

from typing import Any

from mabirds_core.extras import require
from mabirds_core.games.drones.planner_settings import LatticeSettings, SoftActorCriticSettings
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.registry import Kind


def build_drones(settings: DroneSettings) -> Any:
    """The game of the settings."""
    from mabirds_core.games.drones.whole_game import WholeDroneGame

    return WholeDroneGame(settings)


def recorded_drones(observed: Any) -> dict[str, Any]:
    """What an experiment file says of drones in the place of agents that were observed."""
    from mabirds_core.games.drones.observed import observed_settings

    return observed_settings(observed)


def build_lattice(settings: LatticeSettings, game: Any, reward: Any) -> Any:
    """Build the planner that is exact on lattices.

    Parameters
    ----------
    settings : LatticeSettings
        Of the planner.
    game : Any
        Of drones.
    reward : Any
        r_theta.

    Returns
    -------
    Any
        A ``LatticePlanner``.
    """
    from mabirds_core.games.drones.whole_game import build_lattice as built

    return built(settings, game, reward)


def build_soft_actor_critic(settings: SoftActorCriticSettings, game: Any, reward: Any) -> Any:
    """Build the planner of continuous actions.

    Parameters
    ----------
    settings : SoftActorCriticSettings
        Of the planner.
    game : Any
        Of drones.
    reward : Any
        r_theta.

    Returns
    -------
    Any
        A ``GuidedPlanner`` where exact planners know the values, else a ``SacPlanner``.
    """
    from mabirds_core.games.drones.planner_checks import is_guided

    if is_guided(settings, game):
        require("scipy", "exact values of drones", "mabirds_core[drones]")
        from mabirds_core.games.drones.guided_actor import GuidedPlanner

        return GuidedPlanner.of(game, reward, settings.temperature)
    require("torch", "networks of kind soft_actor_critic", "mabirds_core[sac]")
    from mabirds_core.games.drones.soft_actor_critic import SacPlanner  # torch takes a second to load, and 200 MB

    return SacPlanner(game, reward, **settings.model_dump(exclude={"kind", "guide"}))


def check_lattice(settings: LatticeSettings, game: Any) -> None:
    """Check that a lattice suits the game.

    Parameters
    ----------
    settings : LatticeSettings
        Of the planner.
    game : Any
        Of drones.

    Raises
    ------
    ExperimentError
        It does not.
    """
    from mabirds_core.games.drones.planner_checks import check_lattice as check

    check(settings, game)


def check_soft_actor_critic(settings: SoftActorCriticSettings, game: Any) -> None:
    """Check that rollouts fit into memory.

    Parameters
    ----------
    settings : SoftActorCriticSettings
        Of the planner.
    game : Any
        Of drones.

    Raises
    ------
    ExperimentError
        They do not.
    """
    from mabirds_core.games.drones.planner_checks import check_soft_actor_critic as check

    check(settings, game)


FORM = "drones"
DRONES = Kind(DroneSettings, build_drones, form=FORM, recorded=recorded_drones)
LATTICE = Kind(LatticeSettings, build_lattice, form=FORM, check=check_lattice)
SOFT_ACTOR_CRITIC = Kind(SoftActorCriticSettings, build_soft_actor_critic, form=FORM, check=check_soft_actor_critic)
