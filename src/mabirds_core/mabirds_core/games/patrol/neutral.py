"""What a cell would be worth to a patroller if it were like the cells where the policy goes.

A potential moves reward from one place to another and changes no policy of an endless game (Ng, Harada and Russell,
1999), so that the learned weights of single cells say little. What they say beyond a potential is taken from the moves
that the learned policy makes: with r(c, a) the learned reward of move a in cell c, which leads to c', least squares of

    r(c, a) + gamma Phi(c') - Phi(c) = rho,        Phi = 0 at the goal,

weighed by how often it makes each move, find the potential Phi of every cell and the reward rho of an ordinary move;
where moves slip, Phi(c') is the mean over what is made of them.
A neutral cell is one that ordinary moves lead into and out of: r(c, a) = rho + Phi(c) - gamma Phi(c').
"""

from dataclasses import dataclass

import numpy as np

from mabirds_core.arrays import Array, Indices, Mask, Vector


@dataclass(frozen=True)
class ExpertMoves:
    """One expert's moves: what they are worth as learned, and how often the learned policy makes them.

    Attributes
    ----------
    successor : Indices
        The cell after each move, shape (n, M).
    goals : Mask
        The cells where the expert stays, shape (n,).
    rewards : Array
        r(c, a), shape (n, M).
    made : Array
        How often each move is made, discounted, shape (n, M).
    discount : float
        gamma.
    slip : float
        Chance that any of the moves is made for the one that was chosen.
    """

    successor: Indices
    goals: Mask
    rewards: Array
    made: Array
    discount: float
    slip: float = 0.0

    @property
    def visited(self) -> Mask:
        """Cells where the policy goes, shape (n,)."""
        return np.asarray(self.made.sum(axis=1) > 0)

    def neighbours(self, cell: int) -> list[tuple[int, int]]:
        """Moves (c, a) that lead into ``cell`` from visited cells other than the goal."""
        into = (self.successor == cell) & self.visited[:, None]
        into[cell] = into[self.goals] = False
        return [(int(c), int(a)) for c, a in np.argwhere(into)]

    def ordinary(self) -> tuple[Vector, float]:
        """Phi, shape (n,), and rho; where the moves made leave a choice, the one of smallest norm around the mean."""
        made = self.made.copy()
        made[self.goals] = 0.0
        cells, moves = np.nonzero(made)
        rows, n = np.arange(len(cells)), len(made)
        system = np.zeros((len(cells), n + 1))
        np.add.at(system, (rows, cells), 1.0)
        np.add.at(system, (rows, self.successor[cells, moves]), -self.discount * (1 - self.slip))
        for instead in self.successor[cells].T:
            np.add.at(system, (rows, instead), -self.discount * self.slip / self.successor.shape[1])
        system[:, :n][:, self.goals], system[:, n] = 0.0, 1.0
        rewards, weight = self.rewards[cells, moves], np.sqrt(made[cells, moves])
        # Around the mean reward, so that a constant added to all rewards adds to rho and changes nothing else.
        mean = float(np.average(rewards, weights=made[cells, moves]))
        solution = np.linalg.lstsq(system * weight[:, None], (rewards - mean) * weight, rcond=1e-10)[0]
        return np.asarray(solution[:n], dtype=np.float64), mean + float(solution[n])

    def neutral_change(self, cell: int) -> Array | None:
        """What makes ``cell`` neutral, added to r(c, a), shape (n, M); None where no way passes beside it."""
        neighbours = self.neighbours(cell)
        if not neighbours:
            return None
        potential, rho = self.ordinary()
        potential[cell] = np.mean([potential[c] for c, _ in neighbours])
        visited = self.visited
        visited[cell] = True
        outward = [(cell, a) for a in range(self.successor.shape[1]) if visited[self.successor[cell, a]]]
        change = np.zeros_like(self.rewards)
        ahead = potential[self.successor]
        ahead = (1 - self.slip) * ahead + self.slip * ahead.mean(axis=1, keepdims=True)
        for c, a in [*neighbours, *outward]:
            worth = rho + potential[c] - self.discount * ahead[c, a]
            change[c, a] = worth - self.rewards[c, a]
        return change
