"""What a learner keeps of its demonstrations: the newest l of them, or the mean of all.

    observed(n) = (1/l) sum_{i<l} grad J(zeta(n-i))            a window of l, as the paper has it
    observed(n) = (1/n) sum_{i<=n} grad J(zeta(i))             the running mean: ``window: all``

The running mean keeps sums of feature counts and the starts, nothing else: its size does not grow with n.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count, takewhile
from typing import Any, NamedTuple, Protocol

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.costs.models import costs_of
from mabirds_core.errors import CheckpointError
from mabirds_core.games.interface import (
    ConstrainedMarkovGame,
    ShownFeatures,
    Steps,
    Trajectories,
    discounted_visitation,
)
from mabirds_core.rewards.models import RewardModel, SummableReward

MAX_STARTS = 1024
"""Different starts that a running mean keeps, at most: the newest."""


class Memory(Protocol):
    """What was demonstrated until now. Never changed: ``add`` makes a new one."""

    @property
    def examples(self) -> Trajectories | None:
        """Demonstrations at hand, for planners that learn from examples."""
        ...

    @property
    def starts(self) -> Steps:
        """Joint states in which demonstrations began, each as often as it did."""
        ...

    @property
    def fill(self) -> float:
        """Share of the window that is filled: terms with n - i <= 0 are zero."""
        ...

    @property
    def shown(self) -> ShownFeatures | None:
        """What all demonstrations showed of cost features; None where some are forgotten."""
        ...

    def add(self, demonstrations: Trajectories) -> "Memory":
        """The memory with the demonstrations of the next iteration, one row each."""
        ...

    def observed(self, parameters: Parameters) -> Parameters:
        """Means of grad J and of mu over the demonstrations, at theta and omega."""
        ...

    def to_arrays(self) -> dict[str, Array]:
        """What a checkpoint must hold for the iterations to come."""
        ...

    def from_arrays(self, arrays: Mapping[str, Array]) -> "Memory":
        """The memory again.

        Parameters
        ----------
        arrays : Mapping[str, Array]
            What ``to_arrays`` gave.

        Returns
        -------
        Memory
            As it was.

        Raises
        ------
        MabirdsError
            The arrays do not fit the game.
        """
        ...


def stacked(demonstrations: tuple[Trajectories, ...] | list[Trajectories]) -> Trajectories:
    """Several sets of trajectories as one."""
    return Trajectories(
        np.concatenate([trajectories.states for trajectories in demonstrations]),
        np.concatenate([trajectories.actions for trajectories in demonstrations]),
    )


@dataclass(frozen=True)
class WindowMemory:
    """The newest ``length`` sets of demonstrations, newest first."""

    game: ConstrainedMarkovGame
    reward: RewardModel
    length: int
    newest: tuple[Trajectories, ...] = ()
    padded: bool = True
    """Terms that there are not yet count as zero, as in the paper; else the mean is over those there are."""

    @cached_property
    def examples(self) -> Trajectories:
        """All of the window."""
        return stacked(self.newest)

    @property
    def starts(self) -> Steps:
        """Of all of the window."""
        return self.examples.states[:, 0]

    @property
    def fill(self) -> float:
        """How many of the ``length`` terms there are yet."""
        return len(self.newest) / self.length if self.padded else 1.0

    @property
    def shown(self) -> None:
        """A window forgets."""

    def add(self, demonstrations: Trajectories) -> "WindowMemory":
        """The oldest makes way."""
        return replace(self, newest=(demonstrations, *self.newest)[: self.length])

    def observed(self, parameters: Parameters) -> Parameters:
        """Means over the window."""
        visitation, costs = discounted_visitation(self.examples, self.game.discount), costs_of(self.game)
        return Parameters(
            self.reward.gradient(parameters.theta, visitation),
            costs.gradient_of_total(parameters.omega, costs.total(visitation)),
        )

    def to_arrays(self) -> dict[str, Array]:
        """recent.K.states, recent.K.actions; not the oldest, which the next one replaces."""
        arrays = dict[str, Array]()
        for number, trajectory in enumerate(self.newest[: self.length - 1]):
            arrays |= dict(zip(_names(number), self.game.encode(trajectory), strict=True))
        return arrays

    def from_arrays(self, arrays: Mapping[str, Array]) -> "WindowMemory":
        """As many as there are."""
        recorded = takewhile(lambda names: set(names) <= arrays.keys(), map(_names, count()))
        newest = tuple(self.game.decode(*(arrays[name] for name in names)) for names in recorded)
        return replace(self, newest=newest)


def _names(number: int) -> tuple[str, str]:
    """Where the demonstration that is ``number`` iterations older than the newest is kept."""
    return f"recent.{number}.states", f"recent.{number}.actions"


class Sums(NamedTuple):
    """Sums over the demonstrations of all iterations.

    Attributes
    ----------
    demonstrations : int
        How many.
    reward : Vector
        Discounted counts of the reward features, shape (K_f,).
    cost : Vector
        Discounted counts of the cost features, and what else gradients of the costs hang on, shape (K_c,).
    starts : Any
        Different starts, one per row or entry, in the order in which they came first.
    start_counts : Indices
        How often each came, of the same length.
    """

    demonstrations: int
    reward: Vector
    cost: Vector
    starts: Any
    start_counts: Indices


@dataclass(frozen=True)
class RunningMean:
    """The mean of all demonstrations, for rewards whose gradient hangs on feature counts alone."""

    game: ConstrainedMarkovGame
    reward: SummableReward
    sums: Sums
    newest: Trajectories | None = None

    @staticmethod
    def empty(game: ConstrainedMarkovGame, reward: SummableReward) -> "RunningMean":
        """The memory before the first demonstration.

        Parameters
        ----------
        game : ConstrainedMarkovGame
            Whose costs are counted.
        reward : SummableReward
            Whose features are counted.

        Returns
        -------
        RunningMean
            Of nothing.
        """
        nothing = np.zeros(0, dtype=np.int64)
        sums = Sums(0, np.zeros(reward.total_size), np.zeros(costs_of(game).total_size), nothing, nothing)
        return RunningMean(game, reward, sums)

    @property
    def examples(self) -> Trajectories | None:
        """The newest; none right after a restart."""
        return self.newest

    @property
    def starts(self) -> Steps:
        """Each as often as it came."""
        return np.repeat(self.sums.starts, self.sums.start_counts, axis=0)

    @property
    def fill(self) -> float:
        """A mean of all is always whole."""
        return 1.0

    @cached_property
    def shown(self) -> ShownFeatures:
        """By the sums of their counts."""
        of_features = self.sums.cost[: len(self.game.cost_features.names)]
        return ShownFeatures(of_features > 0, self.sums.demonstrations)

    def add(self, demonstrations: Trajectories) -> "RunningMean":
        """Their counts are added."""
        rows, visitation = len(demonstrations.states), discounted_visitation(demonstrations, self.game.discount)
        reward, cost = rows * self.reward.total(visitation), rows * costs_of(self.game).total(visitation)
        old = self.sums
        sums = old._replace(demonstrations=old.demonstrations + rows, reward=old.reward + reward, cost=old.cost + cost)
        return RunningMean(self.game, self.reward, _with_starts(sums, demonstrations.states[:, 0]), demonstrations)

    def observed(self, parameters: Parameters) -> Parameters:
        """Means over all demonstrations."""
        of_reward, of_costs = (sums / self.sums.demonstrations for sums in (self.sums.reward, self.sums.cost))
        return Parameters(
            self.reward.gradient_of_total(parameters.theta, of_reward),
            costs_of(self.game).gradient_of_total(parameters.omega, of_costs),
        )

    def to_arrays(self) -> dict[str, Array]:
        """observed.demonstrations, observed.reward, observed.cost, observed.starts, observed.start_counts."""
        sums = self.sums._asdict()
        return {f"observed.{name}": np.atleast_1d(np.asarray(values, np.float64)) for name, values in sums.items()}

    def from_arrays(self, arrays: Mapping[str, Array]) -> "RunningMean":
        """The sums again; the newest demonstration, an example at most, is not kept."""
        kept = {name: arrays[f"observed.{name}"] for name in Sums._fields if f"observed.{name}" in arrays}
        if len(kept) < len(Sums._fields):
            raise CheckpointError(f"observed: expected arrays {list(Sums._fields)}, found {list(kept)}")
        return RunningMean(self.game, self.reward, _sums_of(self.game, self.reward, kept))


def _with_starts(sums: Sums, begun: Steps) -> Sums:
    """The sums with more starts; of many different ones only the newest are kept."""
    starts, counts = np.asarray(sums.starts), sums.start_counts.copy()
    for start in begun:
        equal = starts == start if len(starts) else starts
        same = np.flatnonzero(equal if equal.ndim < 2 else equal.all(axis=1))
        if len(same):
            counts[same[0]] += 1
        else:
            starts = np.concatenate([starts, [start]] if len(starts) else [[start]])[-MAX_STARTS:]
            counts = np.append(counts, 1)[-MAX_STARTS:]
    return sums._replace(starts=starts, start_counts=counts)


def _sums_of(game: ConstrainedMarkovGame, reward: SummableReward, kept: Mapping[str, Array]) -> Sums:
    """Sums of a checkpoint; raises CheckpointError for what cannot be such."""
    for name, size in (("reward", reward.total_size), ("cost", costs_of(game).total_size)):
        if kept[name].shape != (size,) or not np.isfinite(kept[name]).all():
            raise CheckpointError(f"observed.{name}: expected {size} finite numbers")
    demonstrations, counts = kept["demonstrations"], kept["start_counts"]
    if demonstrations.shape != (1,) or not _whole(demonstrations, 0):
        raise CheckpointError("observed.demonstrations: expected one whole number")
    if counts.ndim != 1 or not _whole(counts, 1) or counts.sum() > demonstrations[0]:
        raise CheckpointError("observed.start_counts: expected whole numbers from 1, in sum at most the demonstrations")
    starts = _starts_of(game, kept["starts"], len(counts))
    return Sums(int(demonstrations[0]), kept["reward"], kept["cost"], starts, counts.astype(np.int64))


def _starts_of(game: ConstrainedMarkovGame, starts: Array, count: int) -> Steps:
    """Starts of a checkpoint: joint states of a tabular game are numbers below S, others are rows of real numbers."""
    if not starts.ndim or len(starts) != count:
        raise CheckpointError(f"observed.starts: expected {count}, as many as there are start_counts")
    if not count:
        return np.zeros(0, dtype=np.int64)
    n_states, size = getattr(game, "n_states", None), getattr(game, "state_size", starts.shape[-1])
    if n_states is None:
        if starts.shape != (count, size) or not np.isfinite(starts).all():
            raise CheckpointError(f"observed.starts: expected {count} joint states of {size} finite numbers")
        return starts
    if starts.ndim != 1 or not _whole(starts, 0) or (starts >= n_states).any():
        raise CheckpointError(f"observed.starts: expected numbers of states below {n_states}")
    return starts.astype(np.int64)


def _whole(values: Array, least: int) -> bool:
    """Are all of them whole numbers of at least ``least``?"""
    return bool((np.isfinite(values) & (values >= least) & (values == np.floor(values))).all())
