"""What a soft actor-critic is told of the game of one or two single integrators: V_t at any place, from exact planners.

    V_t(s) = sum_i V^i_t(s_i) + C_t(s_1, s_2)

with V^i of each drone alone, by quadrature over its disc of actions (``lone_fields``), and with C, what two drones cost
each other, from the planner on a lattice (``coupling``), linear in the triangles between its nodes. Both are in units
of tau. Critics learn what is left; actors follow its gradient; flights of the lattice's policy show where rewards are.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.drones.coupling import DEPTH, LEVELS
from mabirds_core.games.drones.drone_nodes import DroneNodes
from mabirds_core.games.drones.dynamics import DroneDynamics
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePlanner, LatticePolicy
from mabirds_core.games.drones.lone_fields import TAPS, FieldGrid, LoneField, cubic, steps_left
from mabirds_core.games.drones.planner_checks import spacing_of, suits_guide
from mabirds_core.games.drones.planner_settings import LatticeSettings, SoftActorCriticSettings
from mabirds_core.games.drones.rewards import DroneRewardModel
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.interface import Trajectories

LEAST_WEIGHT = 1e-3
"""Where the nodes around two places have less, no drone can be there, and C is 0."""


@dataclass(frozen=True)
class Guide:
    """The values for one theta and omega.

    Attributes
    ----------
    lattice : LatticePolicy
        The policy on a lattice.
    fields : list[LoneField]
        V^i of every drone.
    device : str
        Of the tensors.
    """

    lattice: LatticePolicy
    fields: list[LoneField]
    device: str = "cpu"

    @property
    def game(self) -> DroneGame:
        """Whose values these are."""
        return self.lattice.game

    def flights(self, count: int, rng: np.random.Generator) -> Trajectories:
        """Follow the lattice's policy.

        Parameters
        ----------
        count : int
            How many times.
        rng : np.random.Generator
            Of starts and moves.

        Returns
        -------
        Trajectories
            From P_0.
        """
        return drone_rollouts(self.game, self.lattice, count, rng)

    def start_values(self, states: Array) -> Vector:
        """V_0 of joint states (M, N_E D) with C_0 by first moves to nodes, in nats, shape (M,)."""
        places, result = self.game.positions(states), self.lattice.values(0, states)
        for i, field in enumerate(self.fields):
            result += field.at(0, places[:, i]) - self.lattice.lone_values(i, places[:, i])
        return result

    def worth(self, times: Tensor, actions: Tensor, successors: Tensor) -> Tensor:
        """Q_t(s, a) - r(s, 0) = e(s, a) + gamma V_{t+1}(s').

        Parameters
        ----------
        times : Tensor
            t, whole numbers, shape (M,).
        actions : Tensor
            Shape (M, 2 N_E).
        successors : Tensor
            s', shape (M, N_E D).

        Returns
        -------
        Tensor
            In nats, shape (M,).
        """
        squares = (actions.view(len(actions), self.game.n_experts, 2) ** 2).sum(-1)
        return (squares * self._efforts).sum(-1) + self.game.discount * self.values(times + 1, successors)

    def values(self, times: Tensor, states: Tensor) -> Tensor:
        """V_t of joint states.

        Parameters
        ----------
        times : Tensor
            t, whole numbers from 1 on, shape (M,).
        states : Tensor
            Shape (M, N_E D).

        Returns
        -------
        Tensor
            In nats, shape (M,); 0 past the horizon.
        """
        places = states.view(len(states), self.game.n_experts, 2)
        within = times.clamp(max=self.game.horizon)
        total = torch.stack([self._lone(i, within, places[:, i]) for i in range(len(self.fields))]).sum(0)
        if len(self.fields) == 2:
            total = total + self._coupling(within, places)
        return torch.where(times > within, 0.0, total)

    def _lone(self, drone: int, times: Tensor, places: Tensor) -> Tensor:
        """V^i_t, shape (M,)."""
        field = self.fields[drone]
        counts, at, weights = field.idle.shape, list[Tensor](), list[Tensor]()
        for side in (0, 1):
            way = places[:, side] / float(field.grid.axes[side][1])
            below = way.detach().floor().clamp(1, counts[side] - 3)
            weights.append(torch.stack(cubic(way - below), dim=-1))
            at.append(below.long()[:, None] + self._taps)
        where: Tensor = at[0][:, :, None] * counts[1] + at[1][:, None, :]
        idle, values = self._tables[drone]
        free = values[times[:, None, None] * idle.numel() + where]
        home = ((places - self._regions.goals[drone]) ** 2).sum(-1) <= self._regions.goal_radii[drone] ** 2
        around: Tensor = torch.where(home[:, None, None], self._left[times][:, None, None] * idle[where], free)
        return ((around * weights[1][:, None, :]).sum(-1) * weights[0]).sum(-1)

    def _coupling(self, times: Tensor, places: Tensor) -> Tensor:
        """C_t, shape (M,)."""
        row = times - 1
        nodes, weights = zip(*(self._corners(i, places[:, i], row) for i in (0, 1)), strict=True)
        first, second = nodes[0][:, :, None], nodes[1][:, None, :]
        swapped = self._swapped[row][:, None, None]
        rows, columns = torch.where(swapped, second, first), torch.where(swapped, first, second)
        at = self._offsets[row][:, None, None] + rows * self._strides[row][:, None, None] + columns
        codes: Tensor = torch.from_numpy(self.lattice.memory[at.cpu().numpy()].astype(np.float32)).to(self.device)
        joint: Tensor = weights[0][:, :, None] * weights[1][:, None, :]
        total: Tensor = ((self._tops[row][:, None, None] - codes * (DEPTH / LEVELS)) * joint).sum((1, 2))
        return total / joint.sum((1, 2)).clamp(min=LEAST_WEIGHT)

    def _corners(self, drone: int, places: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
        """The nodes of the triangle around each place and its weights there, shapes (M, 3).

        A node that the drone cannot have reached has none.
        """
        numbers, reached = self._nodes[drone]
        k = places @ self._inverse - self._origin
        below = k.detach().floor()
        (x, y), (i, j) = (k - below).unbind(-1), below.long().unbind(-1)
        upper = x.detach() + y.detach() > 1
        corner = upper.long()
        rows = torch.stack([i + corner, i + 1, i], -1).clamp(0, len(numbers) - 1)
        columns = torch.stack([j + corner, j, j + 1], -1).clamp(0, numbers.shape[1] - 1)
        nodes = numbers[rows, columns]
        low, high = torch.stack([1 - x - y, x, y], -1), torch.stack([x + y - 1, 1 - y, 1 - x], -1)
        known = nodes < reached[row][:, None]
        return torch.where(known, nodes, 0), torch.where(known, torch.where(upper[:, None], high, low), 0.0)

    @cached_property
    def _tables(self) -> list[tuple[Tensor, Tensor]]:
        """r(s, 0) and V^i_t, flat."""
        return [(self._tensor(field.idle).flatten(), self._tensor(field.values).flatten()) for field in self.fields]

    @cached_property
    def _regions(self) -> DroneDynamics:
        return self.game.dynamics.on(self.device, torch.float32)

    @cached_property
    def _efforts(self) -> Tensor:
        return self._tensor([field.effort for field in self.fields])

    @cached_property
    def _left(self) -> Tensor:
        return self._tensor(steps_left(self.game))

    @cached_property
    def _taps(self) -> Tensor:
        return torch.tensor(TAPS, device=self.device)

    @cached_property
    def _nodes(self) -> list[tuple[Tensor, Tensor]]:
        """By k less the least one, the number of the node or of the nearest one; and n_t for t = 1 .. T + 1."""
        of_drones = [drone.nodes for drone in self.lattice.drones]
        return [
            (torch.tensor(self._numbers(of), device=self.device), torch.tensor(of.reached, device=self.device))
            for of in of_drones
        ]

    def _numbers(self, of: DroneNodes) -> Indices:
        basis, origin = self._frame
        k = np.stack(np.meshgrid(*map(np.arange, of.coordinates.max(axis=0) + 2), indexing="ij"), axis=-1)
        places = np.clip((k + origin) @ basis, 0.0, self.game.settings.arena)
        return of.nearest(places.reshape(-1, 2)).reshape(places.shape[:2])

    @cached_property
    def _frame(self) -> tuple[Array, Array]:
        """b_1 and b_2 as rows, and o: nodes are at (k + o) b, with k counted from the least one."""
        lattice = self.lattice.drones[0].nodes.lattice
        k = lattice.places @ np.linalg.inv(lattice.basis)
        return lattice.basis, np.median(k - lattice.coordinates, axis=0)

    @cached_property
    def _inverse(self) -> Tensor:
        return self._tensor(np.linalg.inv(self._frame[0]))

    @cached_property
    def _origin(self) -> Tensor:
        return self._tensor(self._frame[1])

    @cached_property
    def _swapped(self) -> Tensor:
        return torch.tensor([table.swapped for table in self.lattice.tables], device=self.device)

    @cached_property
    def _strides(self) -> Tensor:
        return torch.tensor([table.codes.shape[1] for table in self.lattice.tables], device=self.device)

    @cached_property
    def _offsets(self) -> Tensor:
        """Where the codes of C_t begin in the memory, which the last one has first."""
        sizes = np.array([table.codes.size for table in self.lattice.tables])
        return torch.tensor(sizes[::-1].cumsum()[::-1] - sizes, device=self.device)

    @cached_property
    def _tops(self) -> Tensor:
        return self._tensor([table.top for table in self.lattice.tables])

    def _tensor(self, values: ArrayLike) -> Tensor:
        return torch.tensor(np.array(values), dtype=torch.float32, device=self.device)


@dataclass(frozen=True)
class Guidance:
    """Makes guides for any theta and omega.

    Attributes
    ----------
    planner : LatticePlanner
        Exact on lattices.
    device : str
        Of the tensors.
    """

    planner: LatticePlanner
    device: str = "cpu"

    @cached_property
    def grids(self) -> list[FieldGrid]:
        """Of every drone."""
        return [FieldGrid(self.planner.game, i) for i in range(self.planner.game.n_experts)]

    def guide(self, theta: Vector, omega: Vector, previous: Guide | None, rng: np.random.Generator) -> Guide:
        """Solve.

        Parameters
        ----------
        theta : Vector
            Of the reward.
        omega : Vector
            Weights of the cost features.
        previous : Guide or None
            It is used up: its memory is taken over.
        rng : np.random.Generator
            Of the lattice.

        Returns
        -------
        Guide
            On one of the planner's lattices.
        """
        lattice = self.planner.plan(theta, omega, None if previous is None else previous.lattice, rng)
        fields = [LoneField.of(grid, lattice.rewards, lattice.temperature) for grid in self.grids]
        return Guide(lattice, fields, self.device)


def guidance(settings: SoftActorCriticSettings, game: DroneGame, reward: DroneRewardModel) -> Guidance | None:
    """What the settings say, or the game allows.

    Parameters
    ----------
    settings : SoftActorCriticSettings
        Of the planner.
    game : DroneGame
        Of drones.
    reward : DroneRewardModel
        r_theta.

    Returns
    -------
    Guidance or None
        By a lattice of the default spacing; None: without a guide.
    """
    if settings.guide == "none" or (settings.guide is None and not suits_guide(game)):
        return None
    lattice = LatticeSettings(kind="lattice", temperature=settings.temperature)
    planner = LatticePlanner(game, reward, spacing_of(lattice, game), lattice.temperature)
    return Guidance(planner, settings.device)
