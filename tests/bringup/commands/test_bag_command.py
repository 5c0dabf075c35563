"""``mabirds bag`` on a bag alone: what it holds, whether it is whole, and what can be saved of it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bag_variants import ZSTD, Entry, write_mcap
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader

from mabirds_bringup.commands.bag import bag_app
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.errors import BagError


@pytest.fixture
def long(make_experiment: Callable[..., Path]) -> Experiment:
    return load_experiment(make_experiment(iterations=60))


@pytest.fixture
def entries(long: Experiment) -> list[Entry]:
    with DemonstrationBag(long.demonstrations.bag, build_game(long), long.learners) as bag:
        return [
            Entry(f"/{name}/demonstration", bag.time(name, n), bag.message(name, n))
            for n in range(1, 61)
            for name in long.learners
        ]


def printed(capfd: pytest.CaptureFixture[str], *arguments: object) -> tuple[str, dict[str, Any]]:
    """What a verb tells people, and programs."""
    bag_app([*map(str, arguments), "--json"], standalone_mode=False)
    told = capfd.readouterr()
    return told.err, json.loads(told.out)


def test_info_tells_files_topics_and_demonstrations(
    capfd: pytest.CaptureFixture[str], long: Experiment, entries: list[Entry], tmp_path: Path
) -> None:
    write_mcap(tmp_path / "a.mcap", [*entries, entries[0]], others=10)
    words, content = printed(capfd, "info", tmp_path / "a.mcap")
    assert content["messages"] == {
        "/learner_1/demonstration": 61,
        "/learner_2/demonstration": 60,
        "/odometry": 121,
    }
    assert content["demonstrations"] == {"learner_1": 60, "learner_2": 60}
    topic = content["topics"]["/learner_1/demonstration"]
    assert (topic["demonstrations"], topic["repeated"], topic["learners"]) == (60, 1, ["learner_1"])
    assert topic["games"] == [build_game(long).digest]
    assert topic["last"] - topic["first"] == 59 * 10**9
    assert "/odometry, 121 messages" in words
    assert "demonstrations 1 to 60 of learner_1 in 59 s, repeated 1" in words


def test_a_whole_bag_passes_and_one_with_a_gap_does_not(
    capfd: pytest.CaptureFixture[str], long: Experiment, entries: list[Entry], tmp_path: Path
) -> None:
    words, content = printed(capfd, "check", long.demonstrations.bag)
    assert "whole; /learner_1/demonstration 60, /learner_2/demonstration 60" in words
    assert content["topics"].keys() == {"/learner_1/demonstration", "/learner_2/demonstration"}
    write_mcap(tmp_path / "gap.mcap", entries[:10] + entries[12:])
    with pytest.raises(BagError, match="topic /learner_1/demonstration: iteration 6 is missing, 60 is there"):
        printed(capfd, "check", tmp_path / "gap.mcap")


def test_with_an_experiment_every_transition_is_checked(
    capfd: pytest.CaptureFixture[str], make_experiment: Callable[..., Path], entries: list[Entry], tmp_path: Path
) -> None:
    file = make_experiment(name="other")
    entries[4].message.states[8] = 2.0
    entries[4].message.states[9] = 2.0
    write_mcap(tmp_path / "odd.mcap", entries)
    printed(capfd, "check", tmp_path / "odd.mcap")
    with pytest.raises(BagError, match="iteration 3: step 1: expert 1 moves"):
        printed(capfd, "check", tmp_path / "odd.mcap", "--experiment", file)
    words, _ = printed(capfd, "check", file)
    assert "whole" in words


def test_a_bag_without_demonstrations_names_its_topics(
    capfd: pytest.CaptureFixture[str], entries: list[Entry], tmp_path: Path
) -> None:
    write_mcap(tmp_path / "a.mcap", [entry._replace(topic="/elsewhere") for entry in entries])
    with pytest.raises(BagError, match="no topic .*/demonstration .*; the bag has /elsewhere"):
        printed(capfd, "check", tmp_path / "a.mcap")


def chunks(file: Path) -> list[tuple[int, int]]:
    """Where the chunks of a file begin, and how long they are."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return [(chunk.chunk_start_offset, chunk.chunk_length) for chunk in summary.chunk_indexes]


def test_what_is_before_a_damaged_chunk_can_be_played_again(
    capfd: pytest.CaptureFixture[str], long: Experiment, entries: list[Entry], tmp_path: Path
) -> None:
    layout = ZSTD._replace(options={**ZSTD.options, "chunk_size": 5000})
    damaged = tmp_path / "damaged.mcap"
    write_mcap(damaged, entries, layout, others=10)
    content, places = bytearray(damaged.read_bytes()), chunks(damaged)
    start, length = places[len(places) // 2]
    content[start + length // 2] ^= 1
    damaged.write_bytes(content)
    with pytest.raises(BagError, match="mabirds bag repair"):
        printed(capfd, "check", damaged)
    _, told = printed(capfd, "repair", damaged, tmp_path / "saved")
    assert "the chunk before byte" in told["damage"][0]
    with DemonstrationBag(tmp_path / "saved", build_game(long), long.learners) as bag:
        counts = [bag.count(name) for name in long.learners]
        assert all(0 < count < 60 for count in counts)
        for index, name in enumerate(long.learners):
            assert told["kept"][f"/{name}/demonstration"] == counts[index]
            for n in range(1, counts[index] + 1):
                assert bag.message(name, n) == entries[2 * (n - 1) + index].message
    assert all(told["left_out"][f"/{name}/demonstration"] > 0 for name in long.learners)
    assert 100 < told["kept"]["/odometry"] < 120


def test_a_bag_of_a_killed_recorder_is_saved_and_others_can_read_it(
    capfd: pytest.CaptureFixture[str], entries: list[Entry], tmp_path: Path
) -> None:
    layout = ZSTD._replace(options={**ZSTD.options, "chunk_size": 5000})
    write_mcap(tmp_path / "killed.mcap", entries, layout)
    start, length = chunks(tmp_path / "killed.mcap")[-1]
    content = (tmp_path / "killed.mcap").read_bytes()
    (tmp_path / "killed.mcap").write_bytes(content[: start + length // 2])
    _, told = printed(capfd, "repair", tmp_path / "killed.mcap", tmp_path / "saved")
    kept = told["kept"]["/learner_1/demonstration"]
    assert 0 < kept < 60
    with Reader(tmp_path / "saved") as reader:
        first = [data for connection, _, data in reader.messages() if connection.topic == "/learner_1/demonstration"]
    kind = type(entries[0].message)
    assert [deserialize_message(data, kind) for data in first] == [entry.message for entry in entries[::2]][:kept]


def test_of_nothing_nothing_is_saved(capfd: pytest.CaptureFixture[str], entries: list[Entry], tmp_path: Path) -> None:
    write_mcap(tmp_path / "a.mcap", entries)
    (tmp_path / "a.mcap").write_bytes((tmp_path / "a.mcap").read_bytes()[:100])
    with pytest.raises(BagError, match=r"a\.mcap: no message is intact"):
        printed(capfd, "repair", tmp_path / "a.mcap", tmp_path / "saved")
    assert not (tmp_path / "saved").exists()
