"""Three drones on a lattice, solved all together, to compare pairs with: tables of every three nodes."""

from dataclasses import dataclass

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.games.drones.coupling import Kernel
from mabirds_core.games.drones.drone_nodes import pair_rewards
from mabirds_core.games.drones.guide import Guide
from mabirds_core.games.drones.lone_drone import LoneDrone


@dataclass(frozen=True)
class Trio:
    """C^123_t of V_t = V^1_t + V^2_t + V^3_t + C^123_t, beside what pairs take for it.

    By t = 1 .. T, of shape (n_1, n_2, n_3) each; the first entry is of t = 1.
    """

    drones: list[LoneDrone]
    exact: list[Array]
    by_pairs: list[Array]
    earned: list[Array]
    """What the policy of those pairs is worth, less that of the drones alone."""

    @classmethod
    def of(cls, guide: Guide) -> "Trio":
        """On the lattice of the guide."""
        lattices = [coupling.lattice for coupling in guide.couplings]
        drones = [lattices[0].drones[0], lattices[0].drones[1], lattices[1].drones[1]]
        exact, by_pairs, earned = list[Array](), list[Array](), list[Array]()
        sizes = [int(drone.nodes.reached[-1]) for drone in drones]
        ahead, guessed, error = np.zeros(sizes), np.zeros(sizes), np.zeros(sizes)
        for step in range(guide.game.horizon, 0, -1):
            kernels = [dense(drone.kernel(step), ahead.shape[i]) for i, drone in enumerate(drones)]
            here = rewards(guide, [len(kernel) for kernel in kernels])
            best, _ = backed_up(kernels, guide.game.discount * ahead, error)
            of_pairs, error = backed_up(kernels, guide.game.discount * guessed, guide.game.discount * error)
            ahead, guessed = here + best, tables(guide, step, [len(kernel) for kernel in kernels])
            error = error + here + of_pairs - guessed
            for kept, values in ((exact, ahead), (by_pairs, guessed), (earned, guessed + error)):
                kept.append(values)
        return cls(drones, exact[::-1], by_pairs[::-1], earned[::-1])

    def distances(self, step: int) -> list[Array]:
        """Of drones 1 and 2, 1 and 3, 2 and 3 at every three nodes, of shapes that fit [m]."""
        counts = self.exact[step - 1].shape
        places = [drone.nodes.places[:count] for drone, count in zip(self.drones, counts, strict=True)]
        spread = [places[0][:, None, None], places[1][None, :, None], places[2][None, None, :]]
        return [np.sqrt(((spread[i] - spread[j]) ** 2).sum(axis=-1)) for i, j in ((0, 1), (0, 2), (1, 2))]


def dense(kernel: Kernel, columns: int) -> Array:
    """A kernel as a matrix."""
    result = np.zeros((len(kernel.nodes), columns))
    np.add.at(result, (np.arange(len(result))[:, None], kernel.nodes), kernel.chances)
    return result


def moved(kernels: list[Array], values: Array) -> Array:
    """Expectation of values (S_1, S_2, S_3) after a move of each drone."""
    for i, kernel in enumerate(kernels):
        values = np.moveaxis(np.tensordot(kernel, values, (1, i)), 0, i)
    return values


def backed_up(kernels: list[Array], ahead: Array, later: Array) -> tuple[Array, Array]:
    """log E exp(ahead), and the expectation of ``later`` with the policy that is drawn by exp(ahead)."""
    top = ahead.max()
    chances = np.exp(ahead - top)
    total = moved(kernels, chances)
    return np.log(total) + top, moved(kernels, chances * later) / total


def rewards(guide: Guide, counts: list[int]) -> Array:
    """r_12 + r_13 + r_23 of every three nodes."""
    found = list[Array]()
    for coupling in guide.couplings:
        scaled = tuple((of, weights / guide.temperature) for of, weights in coupling.lattice.rewards)
        first, second = (drone.nodes for drone in coupling.lattice.drones)
        at = np.ogrid[: first.size, : second.size]
        found.append(pair_rewards(first, second, scaled, at).astype(np.float64))
    one, two, three = counts
    return found[0][:one, :two, None] + found[1][:one, None, :three] + found[2][None, :two, :three]


def tables(guide: Guide, step: int, counts: list[int]) -> Array:
    """C^12_t + C^13_t + C^23_t of every three nodes."""
    nodes = np.ogrid[tuple(slice(count) for count in counts)]
    pairs = zip(guide.game.pairs, guide.couplings, strict=True)
    values = (coupling.lattice.tables[step - 1].values(nodes[i], nodes[j]) for (i, j), coupling in pairs)
    return np.asarray(sum(values, np.zeros(counts)))
