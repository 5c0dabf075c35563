"""What went over the network, as its recording has it."""

from collections import Counter
from pathlib import Path
from typing import NamedTuple

import yaml


class Traffic(NamedTuple):
    """What was recorded of a run.

    Attributes
    ----------
    messages : dict[str, int]
        By topic.
    megabytes : float
        Of all files together.
    """

    messages: dict[str, int]
    megabytes: float


def traffic(directory: Path) -> Traffic | None:
    """Messages by topic in the bags of a run directory; None where there are none, or none that is whole."""
    counts, size = Counter[str](), 0
    for bag in sorted(directory.glob("bag*")):
        metadata = bag / "metadata.yaml"
        if not metadata.is_file():
            continue
        content = yaml.safe_load(metadata.read_text(encoding="utf-8"))
        for topic in content["rosbag2_bagfile_information"]["topics_with_message_count"]:
            counts[topic["topic_metadata"]["name"]] += topic["message_count"]
        size += sum(file.stat().st_size for file in bag.glob("*.mcap"))
    return Traffic(dict(sorted(counts.items())), size / 1e6) if counts else None
