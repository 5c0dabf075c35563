"""What two drones cost each other: C_t of V_t(s_1, s_2) = V^1_t(s_1) + V^2_t(s_2) + C_t(s_1, s_2).

    P^i_t(a|s) = mu(a) exp( r_i(s, a) + gamma V^i_{t+1}(s') - V^i_t(s) )
    C_t        = r_12 + log( P^1_t exp(gamma C_{t+1}) (P^2_t)^T ),     C_{T+1} = 0

P are Markov kernels: what one drone's places are worth, thousands of nats, has left the exponentials, and float32 holds
what is left, from its largest value to 160 nats below. Two drones that get there are as good as forbidden to.

C_t is kept for the nodes that the drones can have reached, in 16 bits, from its largest value down in steps of
``DEPTH`` / 65535 nats: the policy is that of values which are off by half a step, .0012 nats, at most.

Tables of R rows are kept in strips of ``LANES`` columns, shape (strips, R, LANES): what is summed together lies
together, which halves the time. Columns that fill the last strip mean nothing.
"""

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from mabirds_core.arrays import Array, Indices
from mabirds_core.games.drones.table_memory import Codes
from mabirds_core.kernels.loading import library, pointer

Float = NDArray[np.float32]

DEPTH = 160.0
"""How far below its largest value C_t is kept [nats]."""

LIFT = 80.0
"""Added in exponents, so that float32, from exp(-87) to exp(88), has room for ``DEPTH``."""

LEAST = np.finfo(np.float32).tiny
"""Sums below this have lost their precision."""

LEVELS = 65535

LANES = 32
"""Columns of a strip."""


class Kernel(NamedTuple):
    """P^i_t: from the n_t nodes that a drone can have reached at t to the n_{t+1} of the next step.

    Attributes
    ----------
    nodes : NDArray[np.int32]
        Where moves lead, shape (n_t, A); any node where there is no such move.
    chances : Float
        Shape (n_t, A); 0 where there is no such move.
    """

    nodes: NDArray[np.int32]
    chances: Float


class Table(NamedTuple):
    """C_t.

    Attributes
    ----------
    codes : Codes
        Steps below ``top`` in strips, a row for each node of drone 1, or of drone 2 where ``swapped``.
    top : float
        The largest value [nats].
    swapped : bool
        Which drone has the rows: it changes from step to step.
    """

    codes: Codes
    top: float
    swapped: bool

    def values(self, first: Indices, second: Indices) -> Array:
        """C_t.

        Parameters
        ----------
        first : Indices
            Nodes of drone 1.
        second : Indices
            Nodes of drone 2, of a shape that fits.

        Returns
        -------
        Array
            In nats, of the shape of both.
        """
        rows, columns = (second, first) if self.swapped else (first, second)
        return np.asarray(self.top - self.codes[columns // LANES, rows, columns % LANES] * (DEPTH / LEVELS))


@dataclass(frozen=True)
class PairProblem:
    """What decides C.

    Attributes
    ----------
    kernel : Callable[[int, int], Kernel]
        P^i_t by i (0 or 1) and t.
    sizes : Indices
        n_t of both drones for t = 1 .. T + 1, shape (2, T + 1).
    rewards : Float
        r_12 in strips, with S_1 rows.
    turned : Float
        r_12 turned round, in strips, with S_2 rows.
    discount : float
        gamma.
    """

    kernel: Callable[[int, int], Kernel]
    sizes: Indices
    rewards: Float
    turned: Float
    discount: float

    def shape(self, step: int) -> tuple[int, int, int]:
        """(strips, rows, LANES) of C_t: drone 2 has the rows at t = T, drone 1 at T - 1, and so on in turns."""
        rows, columns = self.sizes[:: -1 if self.swapped(step) else 1, step - 1]
        return strips(columns), int(rows), LANES

    def swapped(self, step: int) -> bool:
        """Has drone 2 the rows of C_t?"""
        return bool((self.sizes.shape[1] - 1 - step) % 2 == 0)

    @property
    def codes(self) -> int:
        """How many there are at t = 1 .. T."""
        return sum(math.prod(self.shape(step)) for step in range(1, self.sizes.shape[1]))


def couple(problem: PairProblem, memory: Codes) -> list[Table]:
    """C_t for t = 1 .. T.

    Parameters
    ----------
    problem : PairProblem
        What decides them.
    memory : Codes
        In which they are kept, at least ``problem.codes`` long.

    Returns
    -------
    list[Table]
        The first is C_1.
    """
    last, tables, end = problem.sizes.shape[1] - 1, list[Table](), 0
    backup = CompiledBackup(problem) if library() else NumpyBackup(problem)
    for step in range(last, 0, -1):
        swapped, shape = problem.swapped(step), problem.shape(step)
        codes = memory[end : (end := end + math.prod(shape))].reshape(shape)
        rows, columns = (problem.kernel(i, step) for i in ((0, 1) if swapped else (1, 0)))
        top = backup.step(rows, columns, problem.turned if swapped else problem.rewards, codes)
        tables.append(Table(codes, top, swapped))
    return tables[::-1]


class NumpyBackup:
    """One C_t after the other, last first, by sparse products.

    Parameters
    ----------
    problem : PairProblem
        What decides them.
    """

    def __init__(self, problem: PairProblem) -> None:
        self._discount, self._top = problem.discount, 0.0
        rows, columns = problem.sizes[:, -1]
        self._ahead: Float = np.full((rows, LANES * strips(columns)), math.exp(LIFT), np.float32)

    def step(self, rows: Kernel, columns: Kernel, rewards: Float, codes: Codes) -> float:
        """From C_{t+1} to C_t, with rows and columns exchanged.

        Parameters
        ----------
        rows : Kernel
            P_t of the drone that has the rows of C_{t+1}.
        columns : Kernel
            P_t of the other one, which has the rows of C_t.
        rewards : Float
            r_12 in strips, with rows of that one.
        codes : Codes
            Of C_t, to be filled in.

        Returns
        -------
        float
            The largest value of C_t.
        """
        count, width = len(rows.nodes), LANES * len(codes)
        half = np.ascontiguousarray((_sparse(rows, width, self._ahead.shape[0]) @ self._ahead).T)
        values: Float = _sparse(columns, len(columns.nodes), self._ahead.shape[1]) @ half
        np.log(np.maximum(values, LEAST, out=values), out=values)
        in_strips = values.reshape(len(values), -1, LANES).transpose(1, 0, 2)
        in_strips += rewards[: len(codes), : len(values)]
        values += np.float32(self._top - LIFT)
        top = values[:, :count].max()
        np.minimum(values - top, 0, out=values)  # what fills the last strip may be larger
        np.minimum(in_strips * np.float32(-LEVELS / DEPTH) + np.float32(0.5), LEVELS, out=codes, casting="unsafe")
        values *= np.float32(self._discount)
        values += np.float32(LIFT)
        self._ahead, self._top = np.exp(values, out=values), self._discount * float(top)
        return float(top)


def _sparse(kernel: Kernel, rows: int, columns: int) -> csr_array:
    """P of a shape that may be larger: what is beyond is 0."""
    count, width = kernel.nodes.shape
    ends = width * np.minimum(np.arange(rows + 1, dtype=np.int32), count)
    return csr_array((kernel.chances.ravel(), kernel.nodes.ravel(), ends), shape=(rows, columns))


class CompiledBackup:
    """The same by ``kernels/coupling.c``.

    Parameters
    ----------
    problem : PairProblem
        What decides them.
    """

    def __init__(self, problem: PairProblem) -> None:
        self._discount, self._top = problem.discount, 0.0
        self._rows, self._columns = (int(count) for count in problem.sizes[:, -1])
        most = LANES * max(self._rows * strips(self._columns), self._columns * strips(self._rows))
        self._ahead: Float = np.full(most, math.exp(LIFT), np.float32)
        self._values: Float = np.empty(most, np.float32)

    def step(self, rows: Kernel, columns: Kernel, rewards: Float, codes: Codes) -> float:
        """From C_{t+1} to C_t, with rows and columns exchanged.

        Parameters
        ----------
        rows : Kernel
            P_t of the drone that has the rows of C_{t+1}.
        columns : Kernel
            P_t of the other one, which has the rows of C_t.
        rewards : Float
            r_12 in strips, with rows of that one.
        codes : Codes
            Of C_t, to be filled in.

        Returns
        -------
        float
            The largest value of C_t.

        Raises
        ------
        MemoryError
            There is none for a strip of 32 rows.
        """
        size, number = ctypes.c_int64, ctypes.c_float
        top = float(
            compiled().mabirds_couple(
                *(ctypes.byref(Mover.of(kernel)) for kernel in (rows, columns)),
                *(pointer(self._ahead, np.float32), size(self._rows), size(strips(self._columns))),
                *(pointer(rewards, np.float32), size(rewards.shape[1])),
                *(number(self._top - LIFT), pointer(self._values, np.float32)),
            )
        )
        if np.isnan(top):
            raise MemoryError("no memory for a strip of the lattice; take a larger algorithm.policy.spacing")
        compiled().mabirds_encode(
            *(pointer(self._values, np.float32), size(codes.size)),
            *(number(of) for of in (top, LEVELS / DEPTH, self._discount, LIFT)),
            pointer(codes, np.uint16),
        )
        self._ahead, self._values, self._top = self._values, self._ahead, self._discount * top
        self._rows, self._columns = len(columns.nodes), len(rows.nodes)
        return top


class Mover(ctypes.Structure):
    """A ``Kernel`` as C has it."""

    _fields_: ClassVar = [
        ("count", ctypes.c_int64),
        ("moves", ctypes.c_int64),
        ("nodes", ctypes.c_void_p),
        ("chances", ctypes.c_void_p),
    ]

    @classmethod
    def of(cls, kernel: Kernel) -> "Mover":
        """It holds no reference to the kernel, which must outlive it."""
        return cls(*kernel.nodes.shape, pointer(kernel.nodes, np.int32), pointer(kernel.chances, np.float32))


@cache
def compiled() -> ctypes.CDLL:
    """The kernels.

    Returns
    -------
    ctypes.CDLL
        With the types of what they return.

    Raises
    ------
    RuntimeError
        They are not compiled.
    """
    kernels = library()
    if kernels is None:
        raise RuntimeError("no compiled kernels; use NumpyBackup")
    kernels.mabirds_couple.restype = ctypes.c_float
    kernels.mabirds_encode.restype = None
    return kernels


def strips(columns: int) -> int:
    """How many there are of a table."""
    return -(-int(columns) // LANES)


def strip_indices(rows: int, columns: int) -> tuple[Indices, Indices]:
    """Row and column of the entries of a table in strips.

    Parameters
    ----------
    rows : int
        R.
    columns : int
        How many it has. The last of them fills the last strip.

    Returns
    -------
    tuple[Indices, Indices]
        Shapes (1, R, 1) and (strips, 1, LANES).
    """
    at = np.minimum(np.arange(LANES * strips(columns)), columns - 1)
    return np.arange(rows)[None, :, None], at.reshape(-1, 1, LANES)
