"""Which planners suit which games of drones."""

import math

from mabirds_core.errors import ExperimentError
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.nodes import COVERING, SLACK, SYMMETRY
from mabirds_core.games.drones.planner_settings import LatticeSettings, SoftActorCriticSettings
from mabirds_core.planners.settings import check_rollouts

MAX_VALUES = 1_000_000_000
"""Values that a policy may keep on a lattice: 2 gigabytes for two drones and more, 8 for one."""

GUIDE = LatticeSettings(kind="lattice")
"""By which actors are guided."""


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
        There are more than two drones, they are no single integrators, drones cannot fly from node to node or find
        none in a goal region, or values do not fit into memory.
    """
    if not suits_lattice(game):
        raise ExperimentError(
            f"algorithm.policy lattice: made for one or two single integrators, found {game.n_experts} drones that"
            f" are {game.settings.dynamics}s; take soft_actor_critic"
        )
    spacing = spacing_of(lattice, game)
    _check_reach(lattice, spacing, game)
    if (values := _values(lattice, game)) > MAX_VALUES:
        raise ExperimentError(
            f"algorithm.policy.spacing {spacing:g} m makes {values:.2g} values, expected at most"
            f" {MAX_VALUES:.2g}; take a larger one"
        )


def check_guide(game: DroneGame) -> None:
    """Check that exact planners can guide an actor, of any number of drones, by pairs.

    Parameters
    ----------
    game : DroneGame
        Of drones.

    Raises
    ------
    ExperimentError
        They are no single integrators, a goal region is so small that lattices may have no node in it, or values of all
        pairs do not fit into memory.
    """
    if game.settings.dynamics != "single_integrator":
        raise ExperimentError(
            f"algorithm.policy.guide lattice: made for single integrators, found {game.settings.dynamics}s, whose"
            " lattices would need four dimensions a drone; set guide to none"
        )
    _check_reach(GUIDE, spacing_of(GUIDE, game), game)
    if (values := _values(GUIDE, game)) > MAX_VALUES:
        raise ExperimentError(
            f"algorithm.policy.guide lattice: {len(game.pairs)} pairs of drones make {values:.2g} values, expected at"
            f" most {MAX_VALUES:.2g}; set guide to none, take fewer drones, or make a step longer (game.time_step)"
        )


def fits(lattice: LatticeSettings, game: DroneGame) -> bool:
    """Whether the values of a policy on the lattice fit into memory.

    Parameters
    ----------
    lattice : LatticeSettings
        Settings of the planner.
    game : DroneGame
        Of drones.

    Returns
    -------
    bool
        At most MAX_VALUES.
    """
    return _values(lattice, game) <= MAX_VALUES


def _values(lattice: LatticeSettings, game: DroneGame) -> float:
    """How many there are if drones can reach all nodes at once; of three drones or more, those of all pairs."""
    area = spacing_of(lattice, game) ** 2 * math.sin(SYMMETRY[lattice.shape])
    nodes: float = math.prod(game.settings.arena) / area
    tables = nodes if game.n_experts == 1 else nodes**2 * len(game.pairs)
    return tables * (game.horizon + 1)


def spacing_of(lattice: LatticeSettings, game: DroneGame) -> float:
    """Of neighbouring nodes [m]: 1 / sqrt(3) of the way of a step where the settings do not say.

    Parameters
    ----------
    lattice : LatticeSettings
        Settings of the planner.
    game : DroneGame
        Of drones.

    Returns
    -------
    float
        At which a hexagonal lattice has 13 moves.
    """
    return game.dynamics.reach / math.sqrt(3) if lattice.spacing is None else lattice.spacing


def _check_reach(lattice: LatticeSettings, spacing: float, game: DroneGame) -> None:
    """Drones must be able to fly to neighbouring nodes, and each goal region must have a node."""
    if spacing > game.dynamics.reach * (1 + SLACK):
        raise ExperimentError(
            f"algorithm.policy.spacing {spacing:g} m: drones fly {game.dynamics.reach:g} m in a step, and would reach"
            " no other node; take a smaller one"
        )
    for number, task in enumerate(game.settings.drones, start=1):
        least = COVERING[lattice.shape] * spacing
        if task.goal_region.radius < least:
            raise ExperimentError(
                f"game.drones: goal_region of drone {number} has radius {task.goal_region.radius:g} m, and may have no"
                f" node; expected at least {least:g} m for algorithm.policy.spacing {spacing:g} m"
            )


def is_guided(settings: SoftActorCriticSettings, game: DroneGame) -> bool:
    """Whether exact planners are to take the place of networks: where they can, unless the settings say not to.

    Parameters
    ----------
    settings : SoftActorCriticSettings
        Of the planner.
    game : DroneGame
        Of drones.

    Returns
    -------
    bool
        Of one or two drones they are exact, of more by pairs.
    """
    if settings.guide == "none":
        return False
    try:
        check_guide(game)
    except ExperimentError:
        return False
    return True


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
        It does not, or the guide does not suit the game.
    """
    check_rollouts("policy.rollouts", settings.rollouts, game.horizon)
    if game.dynamics.goal_ways is not None:
        raise ExperimentError("algorithm.policy.kind soft_actor_critic: goal regions must be discs; take lattice")
    if settings.guide == "lattice":
        check_guide(game)
