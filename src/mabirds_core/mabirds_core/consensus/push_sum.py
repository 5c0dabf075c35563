"""Push-sum with running sums: averaging that loses nothing although messages are lost.

A learner holds a mass s (theta and omega) and its weight y; its estimate is s / y. In a slot that opens the edge to u
it gives u the share W[u, v] of mass and weight and keeps W[v, v]. What it sends is not the share but the sum
sigma_uv of all shares it ever gave to u, and u adds what is new to it since the sum rho_uv that it took last:

    s_v <- W[v, v] s_v + sum_u (sigma_vu - rho_vu),     rho_vu <- sigma_vu,     the same for y

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
        """A sum of nothing."""
        return cls(np.zeros(size), np.zeros(size))

    def plus(self, values: Vector) -> "RunningSum":
        """The sum with ``values`` added; exact (Knuth's two-sum), up to the rounding of ``rest``."""
        total = self.total + values
        part = total - self.total
        return RunningSum(total, self.rest + ((self.total - (total - part)) + (values - part)))

    def since(self, earlier: "RunningSum") -> Vector:
        """What was added after ``earlier``."""
        return np.asarray((self.total - earlier.total) + (self.rest - earlier.rest))


class Ledger(NamedTuple):
    """One learner's side of the exchange: its mass, and by neighbour what it gave and what it took in all."""

    own: Vector
    given: Mapping[str, RunningSum]
    taken: Mapping[str, RunningSum]

    @property
    def weight(self) -> float:
        """y."""
        return float(self.own[-1])

    def give(self, shares: Mapping[str, float], kept: float) -> "Ledger":
        """Give each neighbour its share of the mass and keep the share ``kept``; shares and kept sum to 1."""
        given = {name: self._given(name).plus(share * self.own) for name, share in shares.items()}
        return Ledger(kept * self.own, {**self.given, **given}, self.taken)

    def _given(self, name: str) -> RunningSum:
        return self.given.get(name) or RunningSum.zero(self.own.size)

    def take(self, name: str, total: RunningSum) -> "Ledger":
        """Add what ``name`` has given since its sum was taken last."""
        news = total.since(self.taken.get(name) or RunningSum.zero(self.own.size))
        return Ledger(self.own + news, self.given, {**self.taken, name: total})

    def estimate(self, n_theta: int) -> Parameters:
        """s / y as theta (the first ``n_theta`` numbers) and omega."""
        ratio = self.own[:-1] / self.weight
        return Parameters(ratio[:n_theta], ratio[n_theta:])

    def moved(self, step: Parameters) -> "Ledger":
        """The step added to the mass; the weight stays."""
        return self._replace(own=self.own + np.concatenate([step.theta, step.omega, [0.0]]))


def opening(parameters: Parameters, weight: float = 1.0) -> Ledger:
    """The ledger of a learner that knows nobody yet. ``weight`` 0: a newcomer, which brings no mass."""
    return Ledger(weight * np.concatenate([parameters.theta, parameters.omega, [1.0]]), {}, {})
