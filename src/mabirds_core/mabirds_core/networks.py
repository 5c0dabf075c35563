"""A small network with bounded values and gradients, of which rewards and costs are made.

    f(x) = tanh( sum_h tanh(v_h) tanh(U_h x + b_h) ),        -1 < f < 1

As tanh, its first and its second derivative are bounded, and v enters through tanh alone, the gradient and the Hessian
of f are bounded for all parameters (Assumption 1): |df/dv_h| <= 1, |df/db_h| <= 1, |df/dU_hd| <= 1 for x in [-1, 1]^D.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mabirds_core.arithmetic import product, tanh
from mabirds_core.arrays import Array, Vector


class Layers(NamedTuple):
    """The parameters by layer: D inputs, H hidden units."""

    inputs: Array
    """U, shape (H, D)."""
    hidden: Vector
    """b, shape (H,)."""
    outputs: Vector
    """v, shape (H,)."""


@dataclass(frozen=True)
class BoundedNetwork:
    """f at K points.

    Attributes
    ----------
    points : Array
        x_k in [-1, 1]^D, shape (K, D).
    hidden : int
        H: hidden units.
    """

    points: Array
    hidden: int

    @property
    def size(self) -> int:
        """H (D + 2)."""
        return self.hidden * (len(self.points[0]) + 2)

    def initial(self, rng: np.random.Generator) -> Vector:
        """Standard normal inputs; outputs of zero, so that f = 0 everywhere."""
        drawn = rng.normal(size=self.size - self.hidden)
        return np.concatenate([drawn, np.zeros(self.hidden)])

    def values(self, parameters: Vector) -> Vector:
        """f(x_k), shape (K,)."""
        layers = self._layers(parameters)
        return tanh(_weighed(self._activations(layers), layers))

    def gradient(self, parameters: Vector, weights: Vector) -> Vector:
        """Backwards through the network.

        Parameters
        ----------
        parameters : Vector
            U, b, v, shape (size,).
        weights : Vector
            Of the points, shape (K,).

        Returns
        -------
        Vector
            sum_k weights[k] grad f(x_k), shape (size,).
        """
        layers = self._layers(parameters)
        active = self._activations(layers)
        slope = 1 - tanh(_weighed(active, layers)) ** 2
        of_output = weights * slope
        of_hidden = of_output[:, None] * tanh(layers.outputs) * (1 - active**2)
        of_outputs = product(of_output[None], active)[0] * (1 - tanh(layers.outputs) ** 2)
        return np.concatenate([product(of_hidden.T, self.points).ravel(), of_hidden.sum(axis=0), of_outputs])

    def _layers(self, parameters: Vector) -> Layers:
        inputs, hidden, outputs = np.split(parameters, [self.hidden * self.points.shape[1], self.size - self.hidden])
        return Layers(inputs.reshape(self.hidden, -1), hidden, outputs)

    def _activations(self, layers: Layers) -> Array:
        """tanh(U x_k + b), shape (K, H)."""
        return tanh(product(self.points, layers.inputs.T) + layers.hidden)


def _weighed(active: Array, layers: Layers) -> Vector:
    """sum_h tanh(v_h) times the activations (K, H), shape (K,)."""
    return product(active, tanh(layers.outputs)[:, None])[:, 0]
