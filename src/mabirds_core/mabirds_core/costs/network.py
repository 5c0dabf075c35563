"""A bounded network as cost, with a penalty that keeps it apart from the reward.

    c_omega(s, a) = C/2 ( 1 + f(x(s)) ) + C tanh(z) sum_p psi_p(s, a) [ - w^T phi(s, a) ],    omega = ([w], U, b, v, z)

f is a small network (``networks``), x(s) in [-1, 1]^D what the game tells of a joint state (``CostInputs``), and psi_p
a meeting on the way, such as a swap, which the joint state does not show. C/2 (1 + f) is C times a sigmoid: what a
joint state costs lies between 0 and C. Weights w of the game's cost features may stand beside it, and say what single
cells cost; their gradients are counts, those of the network are none.

**What is identifiable.** Of r_theta - c_omega the demonstrations tell the sum alone. The reward features are, for each
expert i, indicators of place c_i and move, so that r_theta can say every sum of functions of single places, and so can
c_omega: that share of the cost may be moved from one to the other, and no policy changes. The penalty decides:

    P(omega) = apart/2 mean_s ( Pi c(s) - mean c )^2,        Pi c(s) = mean c + sum_i ( m_i(c_i) - mean c )

m_i(k) is the mean of c over all joint states in which expert i is in place k, Pi the projection on the span of the
reward features and the constants, orthogonal with every joint state weighing the same. Joint states are all
combinations of places, so that it is the sum of the main effects (Hoeffding's decomposition), their squares add up,

    P(omega) = apart/2 sum_i mean_k ( m_i(k) - mean c )^2,        dP/dc(s) = apart/S sum_i ( m_i(c_i) - mean c )

and no system of equations is solved. What experts cost each other stays with c, what each costs alone goes to theta;
constants, which change no policy of a fixed horizon, are free.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from mabirds_core.arithmetic import tanh
from mabirds_core.arrays import Array, Indices, Mask, Vector, weighted_counts
from mabirds_core.costs.models import LinearCost
from mabirds_core.games.factored import FactoredReward
from mabirds_core.games.interface import Visitation
from mabirds_core.networks import BoundedNetwork


class Visits(NamedTuple):
    """Where a visitation is.

    Attributes
    ----------
    states : Vector
        Weight of each joint state, shape (S,).
    meetings : float
        Weighted number of meetings on the way.
    """

    states: Vector
    meetings: float


class StateRewards(NamedTuple):
    """-c, or any other number that hangs on joint states and meetings.

    Attributes
    ----------
    states : Vector
        Of joint states, shape (S,).
    meeting : float
        Of each meeting on the way.
    """

    states: Vector
    meeting: float


class CostInputs(Protocol):
    """What a game tells a network of its joint states."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the inputs, shape (D,)."""
        ...

    @property
    def values(self) -> Array:
        """x(s) in [-1, 1]^D, shape (S, D)."""
        ...

    @property
    def places(self) -> Indices:
        """places[i, s]: where expert i is, as its reward features tell it; joint states are all combinations of places.

        Numbers from 0 on, shape (N_E, S).
        """
        ...

    def visits(self, visitation: Visitation) -> Visits:
        """Where a visitation is."""
        ...

    def table(self, rewards: StateRewards) -> Array:
        """The rewards at every pair, shape (S, A)."""
        ...

    def factored(self, rewards: StateRewards) -> FactoredReward | None:
        """The rewards by expert, where the game factorises."""
        ...

    def by_feature(self, rewards: StateRewards) -> Vector:
        """The rewards as weights of the game's cost features, as near as they can say it; shape (K,)."""
        ...


@dataclass(frozen=True)
class NetworkCost:
    """c_omega of a small network.

    Attributes
    ----------
    features : Any
        phi of the game, whose totals tell what was shown.
    inputs : CostInputs
        x(s).
    width : int
        Hidden units.
    bound : float
        C.
    apart : float
        Of the penalty.
    beside_features : bool
        Are there weights of the features, too?
    """

    features: Any
    inputs: CostInputs
    width: int
    bound: float
    apart: float
    beside_features: bool = False
    linear = False

    @property
    def counts(self) -> bool | Mask:
        """Those of the weights of features."""
        if not self.beside_features:
            return False
        result = np.zeros(self.size, dtype=bool)
        result[: self._weights] = LinearCost(self.features).counts
        return result

    @property
    def names(self) -> tuple[str, ...]:
        """Weights of a network have none."""
        return ()

    @cached_property
    def _distinct(self) -> tuple[Array, Indices]:
        """The network's points, and which is each joint state: those that the inputs do not tell apart are one."""
        points, which = np.unique(self.inputs.values, axis=0, return_inverse=True)
        return points, which.ravel()

    @cached_property
    def _network(self) -> BoundedNetwork:
        return BoundedNetwork(self._distinct[0], self.width)

    @property
    def size(self) -> int:
        """width (D + 2) + 1, and K weights."""
        return self._weights + self._network.size + 1

    @property
    def _weights(self) -> int:
        """How many weights of features there are."""
        return len(self.features.names) if self.beside_features else 0

    def _parts(self, omega: Vector) -> tuple[Vector, Vector, Vector]:
        """w, those of the network, and z, shape (1,)."""
        return omega[: self._weights], omega[self._weights : -1], omega[-1:]

    @property
    def total_size(self) -> int:
        """Cost features, points of the network, meetings."""
        return len(self.features.names) + len(self._network.points) + 1

    def initial(self, rng: np.random.Generator) -> Vector:
        """Everything costs C/2, and meetings nothing more."""
        return np.concatenate([np.zeros(self._weights), self._network.initial(rng), [0.0]])

    def of_states(self, omega: Vector) -> Vector:
        """What joint states cost by the network, shape (S,)."""
        return self.bound / 2 * (1 + self._network.values(self._parts(omega)[1]))[self._distinct[1]]

    def of_meeting(self, omega: Vector) -> float:
        """What a meeting on the way costs."""
        return float(self.bound * tanh(omega[-1:])[0])

    def total(self, visitation: Visitation) -> Vector:
        """Totals of the cost features, of the network's points, of meetings; shape (total_size,)."""
        visits, (points, which) = self.inputs.visits(visitation), self._distinct
        return np.concatenate(
            [self.features.total(visitation), weighted_counts(which, visits.states, len(points)), [visits.meetings]]
        )

    def gradient_of_total(self, omega: Vector, total: Vector) -> Vector:
        """Backwards through the network, shape (size,)."""
        visits, meetings = total[len(self.features.names) : -1], total[-1:]
        _, network, z = self._parts(omega)
        of_meeting = -self.bound * (1 - tanh(z) ** 2) * meetings
        of_network = self._network.gradient(network, -self.bound / 2 * visits)
        return np.concatenate([total[: self._weights], of_network, of_meeting])

    def penalty(self, omega: Vector) -> float:
        """P(omega)."""
        return self.apart / 2 * self.shared_variance(omega)

    def shared_variance(self, omega: Vector) -> float:
        """Variance over joint states of what the reward could say as well, Pi c."""
        return float(sum((effect[own] ** 2).mean() for effect, own in self._main_effects(omega)))

    def penalty_gradient(self, omega: Vector) -> Vector:
        """Gradient of P, shape (size,)."""
        if not self.apart:
            return np.zeros_like(omega)
        points, which = self._distinct
        along = sum((effect[own] for effect, own in self._main_effects(omega)), np.zeros(len(which)))
        of_points = weighted_counts(which, self.apart / len(which) * along, len(points))
        of_network = self._network.gradient(self._parts(omega)[1], self.bound / 2 * of_points)
        return np.concatenate([np.zeros(self._weights), of_network, [0.0]])

    def table(self, omega: Vector) -> Array:
        """-c_omega(s, a), shape (S, A)."""
        table = self.inputs.table(self._rewards(omega))
        return table + self.features.table(self._parts(omega)[0]) if self.beside_features else table

    def factored(self, omega: Vector) -> FactoredReward | None:
        """-c_omega(s, a) by expert."""
        factored = self.inputs.factored(self._rewards(omega))
        if factored is None or not self.beside_features:
            return factored
        of_features = LinearCost(self.features).factored(self._parts(omega)[0])
        return None if of_features is None else factored.plus(of_features)

    def by_feature(self, omega: Vector) -> Vector:
        """As near as the game's cost features can say it."""
        weights = self.inputs.by_feature(self._rewards(omega))
        return weights + self._parts(omega)[0] if self.beside_features else weights

    def _rewards(self, omega: Vector) -> StateRewards:
        """-c."""
        return StateRewards(-self.of_states(omega), -self.of_meeting(omega))

    def _main_effects(self, omega: Vector) -> list[tuple[Vector, Indices]]:
        """m_i(k) - mean c by place k, and the place in each joint state, of each expert."""
        return [*zip(main_effects(self.of_states(omega), self.inputs.places), self.inputs.places, strict=True)]


def main_effects(values: Vector, places: Indices) -> list[Vector]:
    """What the place of each expert alone says of numbers of joint states.

    Parameters
    ----------
    values : Vector
        Of joint states, shape (S,).
    places : Indices
        places[i, s], shape (N_E, S).

    Returns
    -------
    list
        Of each expert, means over all joint states with it in a place, less the mean of all; shape (n_i,). Of places
        where nobody can be they say nothing.
    """
    mean = values.mean()
    counts = (np.maximum(np.bincount(own), 1) for own in places)
    return [np.bincount(own, values) / count - mean for own, count in zip(places, counts, strict=True)]
