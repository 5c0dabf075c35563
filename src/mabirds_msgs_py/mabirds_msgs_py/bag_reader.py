"""Reading demonstrations from rosbag2 MCAP bags as people have them, verified when opened.

Iteration numbers decide, not the order of files, messages or times. docs/player.md says which bags are read.
"""

import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from mabirds_msgs.msg import Demonstration
from mcap.records import Channel, Schema
from rclpy.serialization import deserialize_message

from mabirds_core.errors import RefusedMessageError
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories
from mabirds_core.texts import sanitize, truncate
from mabirds_msgs_py.bag_files import bag_files
from mabirds_msgs_py.bag_pass import MAX_LIST, REMEDY, message_data, read_file
from mabirds_msgs_py.conversion import read_demonstration
from mabirds_msgs_py.demonstration_head import DemonstrationHead, demonstration_head
from mabirds_msgs_py.demonstration_spool import Place, Spool
from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.interfaces import type_hash, type_name
from mabirds_msgs_py.mcap_scan import Found, McapScan
from mabirds_msgs_py.topics import bag_topic

OTHER_GAME = "the bag is of another game, or of a version before: record it anew, or name the bag of this game"

CHECKED_AT_ONCE = 1000
"""Demonstrations of each learner whose transitions are checked when a bag is opened; the rest when they are read."""


class DemonstrationBag:
    """The demonstrations of several learners in one bag, or in several that belong together.

    Opening reads every chunk that holds demonstrations once: checksums, types, games, iteration numbers 1, 2, ...
    without a gap, and the first transitions. Exact repetitions are dropped. To be closed, or used in a ``with``
    statement.

    Parameters
    ----------
    bags : Path or Sequence[Path]
        Directories or files; several where learners or times are in bags of their own.
    game : ConstrainedMarkovGame
        Of the demonstrations.
    learners : Sequence[str]
        Names of those whose demonstrations are read.
    at_least : int, optional
        Demonstrations that each of them must have.

    Raises
    ------
    BagError
        Something is wrong, or demonstrations are too few; the message names file, topic and iteration.
    """

    def __init__(
        self, bags: Path | Sequence[Path], game: ConstrainedMarkovGame, learners: Sequence[str], at_least: int = 1
    ) -> None:
        self._bags = [bags] if isinstance(bags, Path) else list(bags)
        self._game, self._at_least = game, at_least
        self._files = [file for bag in self._bags for file in bag_files(bag)]
        self._spools = {learner: Spool() for learner in learners}
        self._counts = Counter[str]()
        try:
            for number in range(len(self._files)):
                self._take(number)
            for learner, spool in self._spools.items():
                self._put_in_order(learner, spool)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the temporary files back; nothing can be read afterwards."""
        for spool in self._spools.values():
            spool.close()

    def count(self, learner: str) -> int:
        """How many demonstrations the learner has."""
        return len(self._spools[learner])

    def time(self, learner: str, iteration: int) -> int:
        """When a demonstration was recorded.

        Parameters
        ----------
        learner : str
            Its name.
        iteration : int
            Of the demonstration, from 1 on.

        Returns
        -------
        int
            Nanoseconds since the epoch.
        """
        return self._spools[learner].place(iteration - 1).time

    def message(self, learner: str, iteration: int) -> Demonstration:
        """A demonstration as it was recorded.

        Parameters
        ----------
        learner : str
            Its name.
        iteration : int
            Of the demonstration, from 1 on.

        Returns
        -------
        Demonstration
            Of this game.

        Raises
        ------
        BagError
            It is no trajectory of the game.
        """
        if iteration > CHECKED_AT_ONCE:
            return self._checked(learner, iteration)[0]
        return self._read(learner, iteration)[0]

    def trajectories(self, learner: str) -> Iterator[Trajectories]:
        """All demonstrations of one learner, in order."""
        for iteration in range(1, self.count(learner) + 1):
            yield self._checked(learner, iteration)[1]

    def _checked(self, learner: str, iteration: int) -> tuple[Demonstration, Trajectories]:
        message, where = self._read(learner, iteration)
        try:
            # A bag recorded from the network names the experiment that was played then; any may learn from it.
            return message, read_demonstration(
                self._game, learner, message, message.experiment_digest.partition(" ")[0]
            )
        except RefusedMessageError as error:
            raise BagError(f"{where}: {error}") from None

    def _read(self, learner: str, iteration: int) -> tuple[Demonstration, str]:
        """A demonstration, and where it is from."""
        spool, index = self._spools[learner], iteration - 1
        where = self._where(learner, spool.place(index).file, iteration)
        return _deserialized(spool.data(index), where), where

    def _where(self, learner: str, file: int, iteration: int) -> str:
        return f"{self._files[file]}: topic {bag_topic(learner)}: iteration {iteration}"

    def _take(self, number: int) -> None:
        """Copy the demonstrations of one file."""
        file, topics = self._files[number], {bag_topic(learner): learner for learner in self._spools}

        def take(found: Found, _: McapScan) -> None:
            learner, data = topics[found.channel.topic], message_data(found.data)
            head = self._head(number, learner, data)
            self._spools[learner].add(head.iteration, data, Place(number, found.time))

        self._counts.update(read_file(file, topics.__contains__, take, partial(_require_type, file)))

    def _head(self, file: int, learner: str, data: bytes) -> DemonstrationHead:
        """For whom a demonstration is and of what game, compared with what it must be."""
        try:
            head = demonstration_head(data)
        except (ValueError, struct.error) as error:
            raise _undecodable(f"{self._files[file]}: topic {bag_topic(learner)}", error) from None
        if head.learner == learner and head.game_digest == self._game.digest:
            return head
        where = self._where(learner, file, head.iteration)
        if head.learner != learner:
            raise BagError(f"{where}: learner {truncate(head.learner)!r}, expected {learner!r}; record the bag anew")
        raise BagError(
            f"{where}: game digest {truncate(head.game_digest)!r}, expected {self._game.digest!r}; {OTHER_GAME}"
        )

    def _put_in_order(self, learner: str, spool: Spool) -> None:
        spool.sort()
        self._drop_repetitions(learner, spool)
        for expected, iteration in enumerate(spool.iterations, start=1):
            if iteration != expected:
                raise BagError(
                    f"{self._where(learner, spool.place(expected - 1).file, iteration)}: expected iteration {expected};"
                    " record the bag anew, or keep what is before it by `mabirds bag repair`"
                )
        self._require_enough(learner, len(spool))
        for iteration in range(1, min(len(spool), CHECKED_AT_ONCE) + 1):
            self._checked(learner, iteration)

    def _drop_repetitions(self, learner: str, spool: Spool) -> None:
        """Of demonstrations that are in the bag several times keep one; two that differ are an error."""
        repeated = []
        for index, (one, other) in enumerate(pairwise(spool.iterations), start=1):
            if one != other:
                continue
            where = self._where(learner, spool.place(index).file, other)
            if not _same(spool.data(index - 1), spool.data(index), where):
                raise BagError(f"{where}: is there several times, with different content; record the bag anew")
            repeated.append(index)
        if repeated:
            spool.drop(repeated)

    def _require_enough(self, learner: str, count: int) -> None:
        if count >= self._at_least:
            return
        bags, topic = ", ".join(map(str, self._bags)), bag_topic(learner)
        words = f"{bags}: topic {topic}: {count} demonstrations, expected at least {self._at_least}"
        if count:
            raise BagError(f"{words}; record more for these learners, or learn fewer")
        raise BagError(f"{words}; {_topics_there(self._counts)}; name a bag that has it, or record one")


def _deserialized(data: bytes, where: str) -> Demonstration:
    try:
        return deserialize_message(data, Demonstration)
    except Exception as error:  # noqa: BLE001 - each middleware raises its own kinds
        raise _undecodable(where, error) from None


def _undecodable(where: str, error: Exception) -> BagError:
    return BagError(f"{where}: a message cannot be decoded ({sanitize(str(error))}); {REMEDY}")


def _same(one: bytes, other: bytes, where: str) -> bool:
    """Bytes between fields may differ, and so may the network that a demonstration was played to."""
    if one == other:
        return True
    messages = [_deserialized(data, where) for data in (one, other)]
    for message in messages:
        message.experiment_digest = ""
    return bool(messages[0] == messages[1])


def _require_type(file: Path, channel: Channel, schema: Schema | None) -> None:
    """Is it a demonstration? An unknown hash is empty or not there."""
    expected, expected_hash = type_name(Demonstration), type_hash(Demonstration)
    name = schema.name if schema else "no type"
    given_hash = channel.metadata.get("topic_type_hash") or expected_hash
    if (name, given_hash, channel.message_encoding) != (expected, expected_hash, "cdr"):
        raise BagError(
            f"{file}: topic {channel.topic}: type {sanitize(name)} ({sanitize(given_hash)},"
            f" {sanitize(channel.message_encoding)}), expected {expected} ({expected_hash}, cdr);"
            " record the bag anew with this version"
        )


def _topics_there(counts: Counter[Any]) -> str:
    """The topics of a bag with the numbers of their messages."""
    topics = [f"{sanitize(topic)} ({count})" for topic, count in sorted(counts.items())]
    return f"the bag has {truncate(', '.join(topics), MAX_LIST) or 'no messages'}"
