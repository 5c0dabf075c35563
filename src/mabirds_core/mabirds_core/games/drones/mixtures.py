"""Mixtures of Gaussians that are squashed into the discs of actions: the densities of an actor.

    pi(a|s) = sum_k w_k prod_i N(u_i; m_ki, L_ki L_ki^T) / |da_i/du_i|,     a_i = a_max (tanh |u_i| / |u_i|) u_i

One Gaussian cannot go round both sides of an obstacle, nor say who gives way; and one without L, whose axes are those
of the arena, is no narrow fan of directions across it.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

LOG_DEVIATIONS = (-4.0, 1.0)
"""Bounds of the logarithms of the diagonal of L."""

NUMBERS = 5
"""Of an action of one drone in one mode: m, and what makes L."""

MIN_SQUARE = 1e-6
"""Keeps lengths off 0, where they have no gradient."""


class Mixture(NamedTuple):
    """M mixtures of K modes.

    Attributes
    ----------
    log_weights : Tensor
        log w, shape (M, K).
    means : Tensor
        Shape (M, K, N_E, 2).
    log_diagonals : Tensor
        log of L_11 and L_22, shape (M, K, N_E, 2).
    slants : Tensor
        L_21, shape (M, K, N_E).
    """

    log_weights: Tensor
    means: Tensor
    log_diagonals: Tensor
    slants: Tensor

    @classmethod
    def of(cls, output: Tensor, modes: int) -> "Mixture":
        """From what a network says.

        Parameters
        ----------
        output : Tensor
            Any numbers, shape (M, K (1 + 5 N_E)).
        modes : int
            K.

        Returns
        -------
        Mixture
            M of them.
        """
        by_mode = output.view(len(output), modes, -1)
        weights, rest = by_mode[..., 0], by_mode[..., 1:].reshape(len(output), modes, -1, NUMBERS)
        low, high = LOG_DEVIATIONS
        diagonals = low + (high - low) * (rest[..., 2:4] + 1).sigmoid()
        return cls(weights.log_softmax(1), rest[..., :2], diagonals, rest[..., 4])

    def draw(self, noise: Tensor) -> Tensor:
        """One u of every mode.

        Parameters
        ----------
        noise : Tensor
            Standard normal, shape (M, K, 2 N_E).

        Returns
        -------
        Tensor
            Shape (M, K, N_E, 2).
        """
        first, second = noise.view(self.means.shape).unbind(-1)
        across, along = self.log_diagonals.exp().unbind(-1)
        return self.means + torch.stack([across * first, self.slants * first + along * second], dim=-1)

    def chosen(self, drawn: Tensor, uniform: Tensor) -> Tensor:
        """One of what the modes have drawn, by their weights.

        Parameters
        ----------
        drawn : Tensor
            Shape (M, K, N_E, 2).
        uniform : Tensor
            In [0, 1), shape (M,).

        Returns
        -------
        Tensor
            Shape (M, 1, N_E, 2).
        """
        cumulative = self.log_weights.exp().cumsum(1)
        mode = (cumulative <= uniform[:, None] * cumulative[:, -1:]).sum(1).clamp(max=cumulative.shape[1] - 1)
        return drawn[torch.arange(len(drawn), device=drawn.device), mode][:, None]

    def act(self, u: Tensor) -> tuple[Tensor, Tensor]:
        """Actions of J values of u for each mixture.

        Parameters
        ----------
        u : Tensor
            Shape (M, J, N_E, 2).

        Returns
        -------
        actions : Tensor
            In the unit disc, shape (M, J, 2 N_E).
        log_pi : Tensor
            Relative to the uniform measure of the discs, shape (M, J).
        """
        away = u[:, :, None] - self.means[:, None]
        first = away[..., 0] * (-self.log_diagonals[:, None, ..., 0]).exp()
        second = (away[..., 1] - self.slants[:, None] * first) * (-self.log_diagonals[:, None, ..., 1]).exp()
        log_gauss = -(first**2 + second**2) / 2 - self.log_diagonals[:, None].sum(-1) - np.log(2 * np.pi)
        actions, log_determinant = squashed(u)
        log_density = torch.logsumexp(self.log_weights[:, None] + log_gauss.sum(-1), dim=2) - log_determinant.sum(-1)
        return actions.flatten(2), log_density + u.shape[2] * np.log(np.pi)


def squashed(u: Tensor) -> tuple[Tensor, Tensor]:
    """Map the plane to the open unit disc.

    Parameters
    ----------
    u : Tensor
        Vectors, shape (..., 2).

    Returns
    -------
    actions : Tensor
        In the disc, shape (..., 2).
    log_determinant : Tensor
        log |da/du|, shape (...). With r = |u| the determinant is sech^2 r along u times tanh r / r across it.
    """
    r = ((u**2).sum(-1) + MIN_SQUARE).sqrt()
    across = r.tanh() / r
    log_along = 2 * (np.log(2.0) - r - torch.nn.functional.softplus(-2 * r))  # log sech^2 r, also where sech^2 r is 0
    return across[..., None] * u, log_along + across.log()
