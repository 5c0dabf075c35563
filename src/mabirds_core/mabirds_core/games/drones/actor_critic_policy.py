"""What a soft actor-critic has found: the networks, what the next search starts from, and how far it is from solved."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.actor_critic_networks import MODES, Adam, Networks
from mabirds_core.games.drones.drone_nodes import Rewards
from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.replay import Replay

GAP_FLIGHTS = 64
"""Flights whose soft returns tell the gap."""


class ActorCritic(NamedTuple):
    """What a gradient step changes."""

    actor: Adam
    critics: Adam
    targets: Tensor

    def on(self, device: str) -> "ActorCritic":
        """The same networks on ``device``."""
        return ActorCritic(self.actor.on(device), self.critics.on(device), self.targets.to(device))


@dataclass(frozen=True)
class Problem:
    """The inner problem of one theta and omega.

    Attributes
    ----------
    game : DroneGame
        Of the drones.
    rewards : Rewards
        What r is the sum of.
    temperature : float
        tau.
    """

    game: DroneGame
    rewards: Rewards
    temperature: float

    def reward(self, states: Array, actions: Array) -> Vector:
        """r(s, a).

        Parameters
        ----------
        states : Array
            Shape (M, N_E D).
        actions : Array
            Shape (M, 2 N_E).

        Returns
        -------
        Vector
            Shape (M,).
        """
        terms = (total_reward(self.game.space, of, weights, states, actions) for of, weights in self.rewards)
        return np.asarray(sum(terms, np.zeros(len(states))))

    def q(self, networks: Networks, critics: Tensor, states: Tensor, times: Tensor, actions: Tensor) -> Tensor:
        """The lesser Q(t, s, a) - r(s, 0) of twin critics, in rewards.

        Parameters
        ----------
        networks : Networks
            Of the game.
        critics : Tensor
            Weights, shape (2, P).
        states : Tensor
            Shape (M, N_E D).
        times : Tensor
            t, shape (M,).
        actions : Tensor
            Shape (M, 2 N_E).

        Returns
        -------
        Tensor
            Shape (M,).
        """
        successors = networks.after(states, actions)
        return networks.horizons[times.long()] * networks.q(critics, states, times, actions, successors).amin(0)


@dataclass(frozen=True)
class SacPolicy:
    """The policy, and what the next search starts from."""

    networks: Networks
    learned: ActorCritic
    replay: Replay
    searches: int
    """How many led to this policy."""
    problem: Problem | None = field(default=None, repr=False)
    """What the last one was for; unknown of a policy that was only remembered."""

    def act(self, step: int, states: Array, rng: np.random.Generator) -> Array:
        """An action for each of M joint states (M, N_E D), shape (M, 2 N_E)."""
        return self.drawn(step, states, rng)[0]

    def drawn(self, step: int, states: Array, rng: np.random.Generator) -> tuple[Array, Vector]:
        """Draw an action for each joint state.

        Parameters
        ----------
        step : int
            t.
        states : Array
            Shape (M, N_E D).
        rng : np.random.Generator
            Of the draw.

        Returns
        -------
        actions : Array
            Shape (M, 2 N_E).
        log_pi : Vector
            Relative to mu, shape (M,).
        """
        now = torch.tensor(states, dtype=torch.float32), torch.full((len(states),), float(step))
        size = self.networks.game.action_size
        noise, uniform = rng.standard_normal((len(states), MODES, size)), rng.random(len(states))
        with torch_threads(1), torch.no_grad():
            mixture = self.networks.mixture(self.learned.actor.weights, *now)
            u = mixture.chosen(mixture.draw(torch.tensor(noise, dtype=torch.float32)), torch.tensor(uniform))
            actions, log_pi = mixture.act(u)
        return self.networks.game.dynamics.max_action * actions[:, 0].double().numpy(), log_pi[:, 0].double().numpy()

    def gap(self, seed: int, flights: int = GAP_FLIGHTS) -> float | None:
        """By how much the soft return of its flights from P_0 lies below V_0, on average.

        V_0 is what its own critics say, so that the gap is no more than how far they err.

        Parameters
        ----------
        seed : int
            Of the flights.
        flights : int, optional
            How many.

        Returns
        -------
        float or None
            In nats; None where it is not known what it was found for.
        """
        if self.problem is None:
            return None
        rng = np.random.default_rng([seed, flights])
        starts = self.networks.game.starts(flights, rng)
        promised = self._promised(self.problem, starts, rng)
        return float((promised - self._soft_returns(self.problem, starts, rng)).mean())

    def _soft_returns(self, problem: Problem, states: Array, rng: np.random.Generator) -> Vector:
        """sum_t gamma^t ( r_t / tau - log pi_t ) of one flight from each joint state."""
        game, result = self.networks.game, np.zeros(len(states))
        for step in range(game.horizon + 1):
            actions, log_pi = self.drawn(step, states, rng)
            result += game.discount**step * (problem.reward(states, actions) / problem.temperature - log_pi)
            states = game.step(states, actions)
        return result

    def _promised(self, problem: Problem, states: Array, rng: np.random.Generator) -> Vector:
        """( r(s, 0) + min_k Q_k(0, s, a) ) / tau - log pi_0(a|s) for an action drawn in each joint state."""
        actions, log_pi = self.drawn(0, states, rng)
        at, chosen = (torch.tensor(values, dtype=torch.float32) for values in (states, actions))
        with torch.no_grad():
            q = problem.q(self.networks, self.learned.critics.weights, at, torch.zeros(len(at)), chosen)
        idle = problem.reward(states, np.zeros_like(actions))
        return np.asarray((idle + q.double().numpy()) / problem.temperature - log_pi)


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """So many threads inside, and what it was after."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
