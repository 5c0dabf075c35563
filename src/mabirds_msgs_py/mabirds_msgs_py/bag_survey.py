"""What a bag holds and whether it is whole, without an experiment."""

import struct
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Channel, Schema

from mabirds_core.texts import sanitize
from mabirds_msgs_py.bag_files import bag_files
from mabirds_msgs_py.bag_pass import message_data, read_file
from mabirds_msgs_py.demonstration_head import demonstration_head
from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.mcap_scan import Found, McapScan
from mabirds_msgs_py.topics import DEMONSTRATION

DEMONSTRATION_TYPE = "mabirds_msgs/msg/Demonstration"


@dataclass
class DemonstrationTopic:
    """The demonstrations of one topic.

    Parameters
    ----------
    learners : set[str]
        Names that they are for.
    games : set[str]
        Digests of the games that they are of.
    iterations : Counter[int]
        How often each is there.
    times : list[int]
        The first and the last log time, nanoseconds since the epoch.
    """

    learners: set[str] = field(default_factory=set)
    games: set[str] = field(default_factory=set)
    iterations: Counter[int] = field(default_factory=Counter)
    times: list[int] = field(default_factory=list)

    @property
    def intact(self) -> int:
        """Iterations 1 to this one are there: what a learner can learn."""
        count = 0
        while count + 1 in self.iterations:
            count += 1
        return count

    @property
    def repeated(self) -> int:
        """Messages beside the first of each iteration."""
        return self.iterations.total() - len(self.iterations)

    def faults(self) -> list[str]:
        """Why a learner cannot learn all of it."""
        found = []
        if self.intact < len(self.iterations):
            found.append(f"iteration {self.intact + 1} is missing, {max(self.iterations)} is there")
        if len(self.learners) > 1:
            found.append(f"it is for several learners: {', '.join(map(sanitize, sorted(self.learners)))}")
        if len(self.games) > 1:
            found.append(f"it is of {len(self.games)} games")
        return found


@dataclass
class BagSurvey:
    """What a bag holds.

    Parameters
    ----------
    files : list[Path]
        In order.
    counts : Counter[str]
        Messages by topic.
    types : dict[str, str]
        Of the topics with demonstrations.
    demonstrations : dict[str, DemonstrationTopic]
        By topic.
    """

    files: list[Path]
    counts: Counter[str] = field(default_factory=Counter)
    types: dict[str, str] = field(default_factory=dict)
    demonstrations: dict[str, DemonstrationTopic] = field(default_factory=dict)

    def faults(self) -> list[str]:
        """Why learners cannot learn from it, by topic."""
        if not self.demonstrations:
            topics = ", ".join(map(sanitize, sorted(self.counts)))
            return [f"no topic .../{DEMONSTRATION} of type {DEMONSTRATION_TYPE}; the bag has {topics or 'no messages'}"]
        return [
            f"topic {sanitize(topic)}: {fault}"
            for topic, content in self.demonstrations.items()
            for fault in content.faults()
        ]


def survey(bag: Path) -> BagSurvey:
    """Read a whole bag.

    Parameters
    ----------
    bag : Path
        A directory or a file.

    Returns
    -------
    BagSurvey
        Of all its files.

    Raises
    ------
    BagError
        It cannot be read, or is damaged.
    """
    result = BagSurvey(bag_files(bag))
    for file in result.files:
        _survey_file(file, result)
    return result


def is_demonstrations(topic: str) -> bool:
    """Is a topic one of demonstrations, by its name?"""
    return topic.endswith(f"/{DEMONSTRATION}")


def _survey_file(file: Path, result: BagSurvey) -> None:
    def check(channel: Channel, schema: Schema | None) -> None:
        result.types[channel.topic] = schema.name if schema else "no type"

    def take(found: Found, _: McapScan) -> None:
        topic = found.channel.topic
        if result.types[topic] == DEMONSTRATION_TYPE:
            _add(file, result.demonstrations.setdefault(topic, DemonstrationTopic()), found)

    result.counts.update(read_file(file, is_demonstrations, take, check))


def _add(file: Path, topic: DemonstrationTopic, found: Found) -> None:
    try:
        head = demonstration_head(message_data(found.data))
    except (ValueError, struct.error) as error:
        raise BagError(
            f"{file}: topic {sanitize(found.channel.topic)}: a message cannot be decoded ({error});"
            " `mabirds bag repair` saves the rest"
        ) from None
    topic.learners.add(head.learner)
    topic.games.add(head.game_digest)
    topic.iterations[head.iteration] += 1
    topic.times = [min([found.time, *topic.times]), max([found.time, *topic.times])]
