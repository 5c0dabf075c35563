"""From places that were recorded to trajectories of the drone game.

At every step each drone makes for the place recorded one step later,

    a_t = (q_{t+1} - p_t) / dt,    of at most the largest length;    p_{t+1} = step(p_t, a_t)

so that what comes out is a flight of the game to the last bit. A drone that is too slow, is stopped by a wall or has
arrived is elsewhere than recorded; by how much is told, and whoever imports decides what is too much.
"""

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.errors import ExperimentError, ImpossibleTrajectoryError
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.recordings import Fit


def fit_places(game: DroneGame, places: Array) -> Fit:
    """Follow places that were recorded.

    Parameters
    ----------
    game : DroneGame
        Of single integrators.
    places : Array
        Of each drone at the steps t = 0 .. T + 1, shape (T + 2, N_E, 2) [m].

    Returns
    -------
    Fit
        One trajectory, and where its drones are.

    Raises
    ------
    ExperimentError
        The game is of double integrators, or the places are not those of T + 2 steps.
    """
    if game.dynamics.drone_size != 2:
        raise ExperimentError("dynamics double_integrator: recordings are imported to single_integrator; set that")
    if places.shape != (game.horizon + 2, game.n_experts, 2):
        raise ExperimentError(f"places: shape {places.shape}, expected {(game.horizon + 2, game.n_experts, 2)}")
    states = np.empty((game.horizon + 2, game.state_size))
    actions = np.empty((game.horizon + 1, game.action_size))
    states[0] = np.clip(places[0], 0.0, game.arena).ravel()
    for step in range(game.horizon + 1):
        actions[step] = _towards(game, states[step], places[step + 1])
        states[step + 1] = game.step(states[step], actions[step])
    flown = game.positions(states[:-1])
    return Fit(Trajectories(states[None, :-1], actions[None]), flown, game.arrived(states[:-1]))


def followed(game: DroneGame, states: Array, actions: Array) -> Trajectories:
    """The flight that follows noisy states and actions, and comes within ``observation_noise`` of them.

    Parameters
    ----------
    game : DroneGame
        Of single integrators.
    states : Array
        As they were observed, shape (T + 1, N_E D).
    actions : Array
        Shape (T + 1, 2 N_E); the last one says where the drones were going.

    Returns
    -------
    Trajectories
        One.

    Raises
    ------
    ImpossibleTrajectoryError
        No drone flies so: the message names the first step that is too far from what was observed.
    """
    observed = game.positions(states)
    after = game.positions(game.step(states[-1], actions[-1]))
    fit = fit_places(game, np.concatenate([observed, after[None]]))
    away, most = np.sqrt(((fit.places - observed) ** 2).sum(axis=-1)), game.settings.observation_noise
    if (wrong := np.argwhere(away > most)).size:
        step, drone = wrong[0]
        raise ImpossibleTrajectoryError(
            f"step {step}: drone {drone + 1} was observed {away[step, drone]:.3g} m from where it can be, expected at"
            f" most observation_noise {most:g} m"
        )
    return fit.trajectory


def _towards(game: DroneGame, state: Array, aims: Array) -> Array:
    """Velocities (2 N_E,) towards places (N_E, 2), of at most the largest length; none for drones that have arrived."""
    velocities = (aims - game.positions(state)) / game.dynamics.time_step
    lengths = np.sqrt((velocities**2).sum(axis=1))[:, None]
    largest = game.dynamics.max_action
    velocities *= np.where(lengths > largest, largest / np.where(lengths > largest, lengths, 1.0), 1.0)
    return np.asarray(np.where(game.arrived(state)[:, None], 0.0, velocities)).ravel()
