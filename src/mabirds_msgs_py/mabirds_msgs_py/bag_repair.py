"""Saving what is intact of a damaged bag into a new one that can be played."""

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from io import SEEK_CUR
from pathlib import Path
from typing import IO

from mcap.records import Channel, Schema

from mabirds_msgs_py.bag_files import bag_files, open_mcap
from mabirds_msgs_py.bag_pass import DAMAGE, message_data
from mabirds_msgs_py.bag_survey import DEMONSTRATION_TYPE, is_demonstrations
from mabirds_msgs_py.bag_writer import BagWriter, TopicType
from mabirds_msgs_py.demonstration_head import demonstration_head
from mabirds_msgs_py.demonstration_spool import Place, Spool
from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.mcap_scan import Found, McapScan


@dataclass
class Repaired:
    """What became of a bag.

    Parameters
    ----------
    kept : Counter[str]
        Messages by topic.
    left_out : Counter[str]
        Demonstrations by topic that come after one that is lost, or again.
    damage : list[str]
        What was wrong, by file.
    """

    kept: Counter[str] = field(default_factory=Counter)
    left_out: Counter[str] = field(default_factory=Counter)
    damage: list[str] = field(default_factory=list)


class _SavingScan(McapScan):
    """Passes over chunks that are damaged, and tells of each."""

    def __init__(self, file: Path, stream: IO[bytes], damage: list[str]) -> None:
        super().__init__(stream, lambda _: True)
        self._file, self._damage = file, damage

    def messages(self) -> Iterator[Found]:
        """As far as records follow upon each other."""
        try:
            yield from super().messages()
        except DAMAGE as error:
            self._damage.append(f"{self._file}: {error}")

    def _chunk(self, length: int) -> Iterator[Found]:
        end = self._stream.seek(0, SEEK_CUR) + length
        try:
            yield from super()._chunk(length)
        except DAMAGE as error:
            self._damage.append(f"{self._file}: the chunk before byte {end}: {error}")
            self._stream.seek(end)


def repair(bag: Path, target: Path) -> Repaired:
    """Write what is intact of a bag to a new one.

    Demonstrations come in order of iteration, each once, up to the first that is lost: nothing after it can be
    learned. Messages of other topics stay as they are.

    Parameters
    ----------
    bag : Path
        A directory or a file.
    target : Path
        Directory to write.

    Returns
    -------
    Repaired
        What was kept and what was not.

    Raises
    ------
    BagError
        There is no such bag, the target exists, or nothing is intact.
    """
    result, spools = Repaired(), dict[str, tuple[TopicType, Spool]]()
    files = bag_files(bag)
    try:
        with BagWriter(target) as writer:
            for file in files:
                _save(file, writer, spools, result)
            for topic, (kind, spool) in spools.items():
                _write_in_order(writer, topic, kind, spool, result)
            if not result.kept:
                words = "; ".join(result.damage) or "it is empty"
                raise BagError(f"{bag}: no message is intact ({words}); fetch it again or record it anew")
    finally:
        for _, spool in spools.values():
            spool.close()
    return result


def _save(file: Path, writer: BagWriter, spools: dict[str, tuple[TopicType, Spool]], result: Repaired) -> None:
    with open_mcap(file) as stream:
        scan = _SavingScan(file, stream, result.damage)
        for found in scan.messages():
            topic, kind = found.channel.topic, _kind(found.channel, scan.schemas.get(found.channel.schema_id))
            with suppress(*DAMAGE):
                data = message_data(found.data)
                if is_demonstrations(topic) and kind.name == DEMONSTRATION_TYPE:
                    iteration = demonstration_head(data).iteration
                    if topic not in spools:
                        spools[topic] = (kind, Spool())
                    spools[topic][1].add(iteration, data, Place(0, found.time))
                    continue
                writer.write_serialized(topic, kind, data, found.time)
                result.kept[topic] += 1


def _kind(channel: Channel, schema: Schema | None) -> TopicType:
    known = channel.metadata.get("topic_type_hash", "")
    if schema is None:
        return TopicType("", known, "", "")
    return TopicType(schema.name, known, schema.data.decode(errors="replace"), schema.encoding)


def _write_in_order(writer: BagWriter, topic: str, kind: TopicType, spool: Spool, result: Repaired) -> None:
    spool.sort()
    expected = 1
    for index, iteration in enumerate(spool.iterations):
        if iteration == expected:
            writer.write_serialized(topic, kind, spool.data(index), spool.place(index).time)
            result.kept[topic] += 1
            expected += 1
        else:
            result.left_out[topic] += 1
