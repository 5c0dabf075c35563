"""The networks of a soft actor-critic for the drone game: rows of weights, functions of them, and Adam.

Nothing here is changed in place: a step of Adam gives new weights. Networks of equal shape, such as twin critics,
are computed together, one row of weights each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from mabirds_core.games.drones.dynamics import DroneDynamics
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.mixtures import MIN_SQUARE, NUMBERS, Mixture

MODES = 4
"""Gaussians of an actor's mixture."""

SPREAD = 0.5
"""Deviation of what they begin with."""

BESIDE, APART = 3, 0.4
"""Of a pair, networks see 2 BESIDE + 1 by as many RBFs of where one is from the other, so far apart [m]."""

LAST_LAYER = 0.01
"""How small the last layer begins beside others, so that all actions are alike at first and worth nothing."""

DECAYS, EPSILON = (0.9, 0.999), 1e-8
"""Adam's."""

WAVES = 4
"""Waves of time that networks see; values bend where goal regions come into reach and where time runs out."""

CLOCK = 2 * WAVES + 1
"""Numbers in which networks are told the time."""


class Adam(NamedTuple):
    """Weights (C, P) of C networks, and what Adam (Kingma and Ba, ICLR 2015) knows of their gradients."""

    weights: Tensor
    mean: Tensor
    square: Tensor
    steps: int

    @classmethod
    def of(cls, weights: Tensor) -> Self:
        """Adam's state for ``weights`` before the first step."""
        return cls(weights, torch.zeros_like(weights), torch.zeros_like(weights), 0)

    def on(self, device: str) -> "Adam":
        """The same state on ``device``."""
        return Adam(self.weights.to(device), self.mean.to(device), self.square.to(device), self.steps)

    def descend(self, gradient: Tensor, rate: float) -> "Adam":
        """Make one step of Adam.

        Parameters
        ----------
        gradient : Tensor
            Shape (C, P).
        rate : float
            Learning rate.

        Returns
        -------
        Adam
            After the step.
        """
        (first, second), count = DECAYS, self.steps + 1
        mean, square = self.mean.lerp(gradient, 1 - first), self.square.lerp(gradient**2, 1 - second)
        step = mean / (1 - first**count) / ((square / (1 - second**count)).sqrt() + EPSILON)
        return Adam(self.weights - rate * step, mean, square, count)


@dataclass(frozen=True)
class Layers:
    """A network of fully connected layers with SiLU between them."""

    widths: tuple[int, ...]
    """Inputs, hidden units, outputs."""

    @property
    def size(self) -> int:
        """P: weights and biases."""
        return sum((n + 1) * m for n, m in pairwise(self.widths))

    def initial(self, copies: int, rng: np.random.Generator) -> Tensor:
        """Draw weights: uniform up to 1 / sqrt(inputs), the last layer far smaller.

        Parameters
        ----------
        copies : int
            C: how many networks.
        rng : np.random.Generator
            Of the weights.

        Returns
        -------
        Tensor
            Shape (C, P).
        """
        drawn = [rng.uniform(-1, 1, size=(copies, (n + 1) * m)) / np.sqrt(n) for n, m in pairwise(self.widths)]
        drawn[-1] *= LAST_LAYER
        return torch.tensor(np.concatenate(drawn, axis=1), dtype=torch.float32)

    def __call__(self, weights: Tensor, inputs: Tensor) -> Tensor:
        """C networks with weights (C, P) at M rows of inputs, shape (C, M, outputs)."""
        copies = len(weights)
        shapes = list(pairwise(self.widths))
        parts = iter(torch.split(weights, [size for n, m in shapes for size in (n * m, m)], dim=1))
        values = inputs.expand(copies, *inputs.shape)
        for number, (n, m) in enumerate(shapes):
            active = torch.nn.functional.silu(values) if number else values
            matrix, bias = next(parts), next(parts)
            values = torch.baddbmm(bias[:, None], active, matrix.view(copies, n, m))
        return values


@dataclass(frozen=True)
class Networks:
    """Actor and critics of a game, on ``device``; times t are floats, shape (M,)."""

    game: DroneGame
    hidden: int
    device: str = "cpu"

    @cached_property
    def actor(self) -> Layers:
        """From s and t to what makes a mixture."""
        outputs = MODES * (1 + NUMBERS * self.game.n_experts)
        return Layers((self._seen + CLOCK, self.hidden, self.hidden, outputs))

    @cached_property
    def critic(self) -> Layers:
        """From s, t, a and s' to q."""
        others = self.game.state_size + CLOCK + self.game.action_size
        return Layers((others + self._seen, self.hidden, self.hidden, 1))

    @cached_property
    def dynamics(self) -> DroneDynamics:
        """The game's dynamics in single precision."""
        return self.game.dynamics.on(self.device, torch.float32)

    @cached_property
    def horizons(self) -> Tensor:
        """h_t = 1 + gamma h_{t+1}, shape (T + 2,)."""
        powers = self.game.discount ** np.arange(self.game.horizon + 1)
        return self._tensor([*powers.cumsum()[::-1], 0.0])

    def clock(self, times: Tensor) -> Tensor:
        """Times as networks see them, shape (M, CLOCK)."""
        angles = np.pi * (times / self.game.horizon)[:, None] * self._waves
        return torch.cat([angles[:, :1] / np.pi, angles.sin(), angles.cos()], dim=1)

    def plain(self, states: Tensor) -> Tensor:
        """States with places and velocities from -1 to 1, shape (M, N_E D)."""
        drones = states.view(len(states), self.game.n_experts, -1)
        places, velocities = drones[..., :2], drones[..., 2:]
        return torch.cat([2 * places / self.dynamics.arena - 1, velocities / self.dynamics.max_speed], dim=2).flatten(1)

    def seen(self, states: Tensor) -> Tensor:
        """States as networks see them: also through RBFs of each drone's place, and of what is between each pair."""
        places = states.view(len(states), self.game.n_experts, -1)[..., :2]
        parts = [self.plain(states), _bumps(places, self._axes, self._width)]
        if self.game.pairs:
            first, second = np.transpose(self.game.pairs).tolist()
            ways = places[:, first] - places[:, second]
            distances = ((ways**2).sum(-1) + MIN_SQUARE).sqrt()[..., None]
            steps = ((self._levels - distances) / self.game.settings.features.distance_softness).sigmoid()
            parts += [distances.flatten(1), steps.flatten(1), _bumps(ways, 2 * [self._beside], APART)]
        return torch.cat(parts, dim=1)

    @property
    def _seen(self) -> int:
        """Numbers in ``seen`` for each state."""
        rbfs, levels = self.game.reward_features.grid.size, len(self.game.settings.features.distance_levels)
        between = 1 + levels + (2 * BESIDE + 1) ** 2
        return self.game.state_size + self.game.n_experts * rbfs + len(self.game.pairs) * between

    @cached_property
    def _beside(self) -> Tensor:
        return APART * self._tensor(range(-BESIDE, BESIDE + 1))

    @cached_property
    def _axes(self) -> list[Tensor]:
        return [self._tensor(axis) for axis in self.game.reward_features.grid.axes]

    @cached_property
    def _width(self) -> float:
        return self.game.reward_features.grid.width

    @cached_property
    def _levels(self) -> Tensor:
        return self._tensor(self.game.settings.features.distance_levels)

    @cached_property
    def _waves(self) -> Tensor:
        return self._tensor(range(1, WAVES + 1))

    def _tensor(self, values: ArrayLike) -> Tensor:
        return torch.tensor(np.array(values), dtype=torch.float32, device=self.device)

    def initial_actor(self, rng: np.random.Generator) -> Tensor:
        """Weights of an actor whose modes differ a little, or they would stay alike, shape (1, P)."""
        weights = self.actor.initial(1, rng)
        outputs = self.actor.widths[-1]
        weights[:, -outputs:] += torch.tensor(SPREAD * rng.standard_normal(outputs), dtype=torch.float32)
        return weights

    def mixture(self, actor: Tensor, states: Tensor, times: Tensor) -> Mixture:
        """The distribution of actions before they are squashed.

        Parameters
        ----------
        actor : Tensor
            Weights, shape (1, P).
        states : Tensor
            Shape (M, N_E D).
        times : Tensor
            Shape (M,).

        Returns
        -------
        Mixture
            M of them.
        """
        (output,) = self.actor(actor, torch.cat([self.seen(states), self.clock(times)], dim=1))
        return Mixture.of(output, MODES)

    def q(self, critics: Tensor, states: Tensor, times: Tensor, actions: Tensor, successors: Tensor) -> Tensor:
        """q_k(t, s, a, s') of each critic.

        Parameters
        ----------
        critics : Tensor
            Weights, shape (2, P).
        states : Tensor
            Shape (M, N_E D).
        times : Tensor
            Shape (M,).
        actions : Tensor
            Shape (M, 2 N_E).
        successors : Tensor
            Shape (M, N_E D).

        Returns
        -------
        Tensor
            Shape (2, M).
        """
        chosen = actions / self.dynamics.max_action
        inputs = torch.cat([self.plain(states), self.clock(times), chosen, self.seen(successors)], dim=1)
        return self.critic(critics, inputs)[..., 0]

    def after(self, states: Tensor, actions: Tensor) -> Tensor:
        """s' of s and a.

        Parameters
        ----------
        states : Tensor
            Shape (M, N_E D).
        actions : Tensor
            Shape (M, 2 N_E).

        Returns
        -------
        Tensor
            Shape (M, N_E D).
        """
        drones, controls = (values.view(len(values), self.game.n_experts, -1) for values in (states, actions))
        return torch.as_tensor(self.dynamics.step(drones, controls)).flatten(1)


def _bumps(ways: Tensor, axes: Sequence[Tensor], width: float) -> Tensor:
    """RBFs of vectors (M, N, 2), centred where the axes cross, shape (M, N X Y)."""
    x, y = (torch.exp(-(((ways[..., i, None] - axes[i]) / width) ** 2) / 2) for i in (0, 1))
    return (x[..., :, None] * y[..., None, :]).flatten(1)
