"""One learner's session without ROS: what has arrived, what is missing, and the next update once nothing is.

How it mixes with its neighbours, and whom it waits for, is its member's: strict_member or push_sum_member.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Generic, TypeVar, cast

import numpy as np

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.storage import parameters_of, to_arrays
from mabirds_core.arrays import Array, Vector
from mabirds_core.digest import arrays_digest
from mabirds_core.errors import CheckpointError, RefusedMessageError
from mabirds_core.games.interface import Trajectories
from mabirds_learner.checkpoint import Checkpoints
from mabirds_learner.inbox import check_iteration
from mabirds_learner.member import Member, indices_of, names_at
from mabirds_learner.preparation import Preparation, prepare
from mabirds_learner.progress import SessionState

DEMONSTRATION = "demonstration"

MIXED_FROM = "mixed_from"
"""Name of the array of those whose parameters entered the newest update, in a checkpoint."""

SHOWN = "last_demonstration_sha256"
"""Name of the array with the digest of zeta(n - 1), in a checkpoint."""

BAG = "bag_sha256"
"""Name of the array with the digest of the bag that demonstrations are from, in a checkpoint."""

OTHER_BAG = "other_bag"
"""Reason for which demonstrations are refused: they are from another bag, or the last learned one came with other
content."""

AMember = TypeVar("AMember", bound=Member)


class LearnerSession(SessionState, Generic[AMember]):
    """One learner's side of the exchange: its demonstrations, its updates, and its past for those who ask.

    ``mixed_from`` names those whose parameters entered the newest update.

    Parameters
    ----------
    member : AMember
        The learner among its neighbours.
    """

    def __init__(self, member: AMember) -> None:
        self.member, self.limits, self.last = member, member.limits, member.limits.last
        self.mixed_from: list[str] = []
        self._learners = member.learner.mixer.schedule.learners
        self._demonstrations: dict[int, Trajectories] = {}
        self._shown: dict[int, Callable[[], Array]] = {}
        """Digest of the newest demonstration that was learned, which is seldom asked for."""
        self._of_other_bag, self._bag = False, ""
        self._preparation: Preparation | None = None
        self._own: dict[int, Parameters] = {self.iteration: self.parameters}
        member.on_join = self._on_join

    @property
    def learner(self) -> Learner:
        """The learner, with its present mixer."""
        return self.member.learner

    @property
    def state(self) -> LearnerState:
        """The learner's state before update n."""
        return self.member.state

    @property
    def epoch(self) -> int:
        """Epoch of the membership that is followed; 0 where there is none, as in strict mode."""
        return self.member.epoch

    @property
    def iteration(self) -> int:
        """n: theta(n), omega(n) are the current estimates."""
        return self.member.state.iteration

    @property
    def finished(self) -> bool:
        """Are all updates made, or has this learner departed?"""
        return self.member.state.iteration > self.last or self.member.departed

    @property
    def backlog(self) -> int:
        """Demonstrations that arrived and are not learned yet."""
        return len(self._demonstrations)

    @property
    def lag(self) -> int:
        """How many iterations a neighbour is known to be ahead."""
        return self.member.lag

    @property
    def missing_demonstration(self) -> bool:
        """Is zeta(n) still to come?"""
        n = self.member.state.iteration
        return n <= self.limits.iterations and n not in self._demonstrations

    def missing_neighbours(self) -> list[str]:
        """In-neighbours of E(n) that the update n waits for."""
        return [] if self.finished else self.member.missing()

    def waiting_for(self) -> list[str]:
        """Names of what is missing for the next update; empty when it can be made."""
        return ([DEMONSTRATION] if self.missing_demonstration else []) + self.missing_neighbours()

    @property
    def ready(self) -> bool:
        """Can the next update be made?"""
        return not (self.missing_demonstration or self.finished or self.member.missing())

    def receive_demonstration(self, iteration: int, trajectory: Trajectories, bag: str = "") -> None:
        """Keep a demonstration.

        Parameters
        ----------
        iteration : int
            n.
        trajectory : Trajectories
            zeta(n).
        bag : str, optional
            Digest of the bag that it is from, where its player says so.

        Raises
        ------
        RefusedMessageError
            It is old, known, or too far ahead, or its player has another bag than the one that was learned from.
        """
        self._require_bag(bag)
        if iteration in self._shown:
            self._of_other_bag = bool((self._shown[iteration]() != _digest(trajectory)).any())
        if self._of_other_bag:
            raise RefusedMessageError(
                OTHER_BAG,
                f"demonstration {self.iteration - 1} is another one than the one that was learned: bring the first bag"
                " back, or start another run",
            )
        ahead = min(self.limits.demonstration_history, self.limits.iterations + 1 - self.iteration)
        check_iteration(iteration, self.iteration, self._demonstrations, ahead, trajectory)
        self._demonstrations[iteration] = trajectory
        self._bag = self._bag or bag

    def _require_bag(self, bag: str) -> None:
        """The first demonstration that names one decides."""
        if bag and self._bag and bag != self._bag:
            raise RefusedMessageError(
                OTHER_BAG,
                f"it is from a bag with digest {bag}, those before it from {self._bag}: end this player, and bring the"
                " first bag back or start another run",
            )

    @property
    def can_prepare(self) -> bool:
        """Can the part of update n that needs nobody else be made, and is it not made yet?"""
        return not (self._is_prepared or self.finished or self.iteration > self.limits.iterations) and (
            self.iteration in self._demonstrations
        )

    @property
    def _is_prepared(self) -> bool:
        """A learner that enters another epoch of a network has another state."""
        return self._preparation is not None and self._preparation.state is self.state

    def prepare(self) -> None:
        """Make steps 1 to 3 of update n, only when ``can_prepare``: neighbours' messages may be under way."""
        self._preparation = None  # two policies at once would be most of the memory
        self._preparation = prepare(self.learner, self.state, self._demonstrations[self.iteration])

    def step(self) -> dict[str, float]:
        """Make update n, only when ``ready``; returns the norms of its gradients and what its member shows."""
        n, incoming, metrics = self.iteration, self.member.incoming(), dict[str, float]()
        if n > self.limits.iterations:
            self.member.state = self.learner.consensus_step(self.state, incoming)
        else:
            metrics = self._mix(incoming)
            self._shown = {n: partial(_digest, self._demonstrations[n])}
        self.mixed_from = list(incoming)
        self.member.close_iteration(n)
        self._close_iteration(n)
        return {**metrics, **self.member.metrics()}

    def _mix(self, incoming: Mapping[str, Any]) -> dict[str, float]:
        """Step 4 of update n, behind what is prepared; returns what the whole of it showed."""
        if self.can_prepare:
            self.prepare()
        _, local, metrics = cast("Preparation", self._preparation)
        self.member.state = self.learner.mixed(self.state, local, incoming).state
        self._preparation = None
        return metrics

    def constraint_confidences(self) -> Vector | None:
        """Confidence that each cost feature is a constraint, by what was demonstrated until now, shape (K,).

        None where nothing was, or where the game or the memory of it cannot say.
        """
        judge, shown = getattr(self.learner.game, "judge", None), self.learner.shown(self.state)
        if judge is None or shown is None or not shown.demonstrations:
            return None
        confidences: Vector | None = judge.constraint_confidences(self.learner.estimator.reward, self.parameters, shown)
        return confidences

    def _on_join(self) -> None:
        """What others learned before this learner joined is not its to learn."""
        self._shown = {}
        for passed in [n for n in self._demonstrations if n < self.iteration]:
            del self._demonstrations[passed]
        self._close_iteration(self.iteration - 1)

    def _close_iteration(self, iteration: int) -> None:
        """Drop what served an update, and own parameters that nobody can ask for any more."""
        self._demonstrations.pop(iteration, None)
        self._own[self.iteration] = self.parameters
        self._own.pop(self.iteration - self.limits.parameter_history, None)

    def arrays(self) -> dict[str, Array]:
        """What a checkpoint must hold to go on from here."""
        mixed_from = {MIXED_FROM: indices_of(self._learners, self.mixed_from)}
        last = self._shown.get(self.iteration - 1)
        shown = {} if last is None else {SHOWN: last()}
        bag = {BAG: _bytes(self._bag)} if self._bag else {}
        return {**to_arrays(self.learner, self.state), **self.member.arrays(), **mixed_from, **shown, **bag}

    def restore(self, checkpoints: Checkpoints) -> None:
        """Go on from the newest complete checkpoint; all of them answer neighbours.

        Raises
        ------
        CheckpointError
            None is complete.
        MabirdsError
            They do not fit the learner.
        """
        self._own = {n: parameters_of(self.learner, arrays) for n, arrays in sorted(checkpoints.items())}
        complete = [n for n, arrays in checkpoints.items() if is_complete(arrays)]
        if not complete:
            raise CheckpointError("no checkpoint is whole; name another directory, or delete this one to start anew")
        newest = max(complete)
        self.member.restore(newest, checkpoints[newest])
        self.mixed_from = names_at(self._learners, checkpoints[newest][MIXED_FROM])
        shown = checkpoints[newest].get(SHOWN)
        self._shown = {} if shown is None else {newest - 1: lambda: shown}
        self._bag = checkpoints[newest][BAG].tobytes().hex() if BAG in checkpoints[newest] else ""

    @property
    def kept(self) -> Mapping[int, Parameters]:
        """theta(n), omega(n) of this learner by n, the oldest first, for those who missed them."""
        return self._own


def _digest(demonstration: Trajectories) -> Array:
    """SHA-256 of states and actions, shape (32,)."""
    return _bytes(arrays_digest(demonstration))


def _bytes(digest: str) -> Array:
    """A hexadecimal digest as numbers, two digits each."""
    return np.frombuffer(bytes.fromhex(digest), dtype=np.uint8)


def is_complete(arrays: Mapping[str, Array]) -> bool:
    """Can a session go on from a checkpoint of these arrays, or is theta and omega all that is left of it?"""
    return MIXED_FROM in arrays
