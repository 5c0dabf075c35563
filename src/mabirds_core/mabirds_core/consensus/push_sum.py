"""Push-sum with running sums: averaging that loses nothing although messages are lost.

A learner holds a mass s (theta and omega) and its weight y; its estimate is s / y. In a slot that opens the edge to u
its outgoing weight for u is W[u, v], and it keeps W[v, v]. What it sends is not W[u, v] s_v but the sum sigma_vu of all
that it ever sent to u, and u adds what is new to it since the sum rho_vu that it received last:

    s_v <- W[v, v] s_v + sum_u (sigma_uv - rho_uv),     rho_uv <- sigma_uv,     the same for y

A message that is lost is contained in the next one. Until then its content is under way, neither lost nor counted
twice: sum_v y_v + sum over edges of (sigma - rho) never changes, and s with it. While everything arrives in its own
iteration y stays 1 and s is what doubly stochastic mixing makes of it. (Hadjicostis, Vaidya and Dominguez-Garcia,
"Robust distributed average consensus via exchange of running sums", IEEE TAC 2016; gradient steps on s as in Nedic and
Olshevsky, "Distributed optimization over time-varying directed graphs", IEEE TAC 2015.)

A mass is one vector, shape (K_theta + K_omega + 1,): theta, omega, and the weight last.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector


class RunningSum(NamedTuple):
    """A sum and what rounding has taken from it, each of shape (K_theta + K_omega + 1,).

    The sums grow for as long as a network runs; with the rest of the rounding kept, differences of them do not suffer.
    """

    total: Vector
    rest: Vector

    @classmethod
    def zero(cls, size: int) -> "RunningSum":
        """The running sum of nothing sent yet."""
        return cls(np.zeros(size), np.zeros(size))

    def plus(self, values: Vector) -> "RunningSum":
        """The sum with ``values`` added; exact (Knuth's two-sum), up to the rounding of ``rest``."""
        total = self.total + values
        part = total - self.total
        return RunningSum(total, self.rest + ((self.total - (total - part)) + (values - part)))

    def since(self, earlier: "RunningSum") -> Vector:
        """What was added after ``earlier``."""
        return np.asarray((self.total - earlier.total) + (self.rest - earlier.rest))


class PushSumState(NamedTuple):
    """One learner's side of the exchange.

    Attributes
    ----------
    mass : Vector
        s and y, shape (K_theta + K_omega + 1,).
    sent : Mapping[str, RunningSum]
        By neighbour: all that it was ever sent, sigma.
    received : Mapping[str, RunningSum]
        By neighbour: all that was taken of what it sent, rho.
    parameters : Parameters
        The estimate theta, omega = s / y, of when y was last large enough for one.
    """

    mass: Vector
    sent: Mapping[str, RunningSum]
    received: Mapping[str, RunningSum]
    parameters: Parameters

    @classmethod
    def init(cls, parameters: Parameters, initial_weight: float = 1.0) -> "PushSumState":
        """A learner that knows nobody yet: s = y (theta, omega).

        Parameters
        ----------
        parameters : Parameters
            theta, omega.
        initial_weight : float, optional
            y; 0 for a learner that brings no mass.

        Returns
        -------
        PushSumState
            With nothing sent or received.
        """
        mass = initial_weight * np.concatenate([parameters.theta, parameters.omega, [1.0]])
        return cls(mass, {}, {}, parameters)

    @property
    def weight(self) -> float:
        """y, the weight of the mass."""
        return float(self.mass[-1])

    def send(self, outgoing_weights: Mapping[str, float], own_weight: float) -> "PushSumState":
        """Give shares of the mass: sigma_vu <- sigma_vu + W[u, v] s_v for each neighbour u, s_v <- W[v, v] s_v.

        Parameters
        ----------
        outgoing_weights : Mapping[str, float]
            W[u, v] by the name of u.
        own_weight : float
            W[v, v]; all weights together sum to 1.

        Returns
        -------
        PushSumState
            After the send.
        """
        sent = {name: self._sent(name).plus(weight * self.mass) for name, weight in outgoing_weights.items()}
        return self._replace(mass=own_weight * self.mass, sent={**self.sent, **sent})

    def _sent(self, name: str) -> RunningSum:
        return self.sent.get(name) or RunningSum.zero(self.mass.size)

    def receive(self, name: str, total: RunningSum) -> "PushSumState":
        """Take what u has sent since its last sum arrived: s_v <- s_v + sigma_uv - rho_uv, rho_uv <- sigma_uv.

        Parameters
        ----------
        name : str
            Of the neighbour u.
        total : RunningSum
            sigma_uv.

        Returns
        -------
        PushSumState
            After the receipt.
        """
        news = total.since(self.received.get(name) or RunningSum.zero(self.mass.size))
        return self._replace(mass=self.mass + news, received={**self.received, name: total})

    def estimate(self) -> Parameters:
        """s / y as theta and omega."""
        ratio, n_theta = self.mass[:-1] / self.weight, self.parameters.theta.size
        return Parameters(ratio[:n_theta], ratio[n_theta:])

    def with_estimate(self) -> "PushSumState":
        """The state with ``parameters`` anew."""
        return self._replace(parameters=self.estimate())

    def add_to_mass(self, step: Parameters) -> "PushSumState":
        """s <- s + step; y stays."""
        return self._replace(mass=self.mass + np.concatenate([step.theta, step.omega, [0.0]]))
