"""Bags as people have them: the same demonstrations, bit for bit, whatever the bag; what cannot be read says why."""

from collections.abc import Callable
from pathlib import Path

import pytest
from bag_variants import VARIANTS, ZSTD, Entry, write_mcap, write_metadata, write_rosbags
from mabirds_msgs.msg import Demonstration
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin

from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.demonstration_head import demonstration_head
from mabirds_msgs_py.errors import BagError

OpenBag = Callable[..., DemonstrationBag]


def content(bag: DemonstrationBag, experiment: Experiment) -> dict[str, list[tuple[bytes, bytes]]]:
    """Bits of all states and actions."""
    return {
        name: [(message.states.tobytes(), message.actions.tobytes()) for message in messages(bag, name)]
        for name in experiment.learners
    }


def messages(bag: DemonstrationBag, name: str) -> list[Demonstration]:
    return [bag.message(name, iteration) for iteration in range(1, bag.count(name) + 1)]


@pytest.fixture
def entries(open_bag: OpenBag, experiment: Experiment) -> list[Entry]:
    """All demonstrations of the experiment, interleaved."""
    bag = open_bag(experiment)
    return [
        Entry(f"/{name}/demonstration", bag.time(name, n), bag.message(name, n))
        for n in range(1, experiment.iterations + 1)
        for name in experiment.learners
    ]


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_kind_of_bag_gives_the_same_bits(
    open_bag: OpenBag, experiment: Experiment, entries: list[Entry], tmp_path: Path, variant: str
) -> None:
    VARIANTS[variant](tmp_path / "variant", entries)
    found = open_bag(experiment, tmp_path / "variant")
    assert content(found, experiment) == content(open_bag(experiment), experiment)
    assert all(found.count(name) == experiment.iterations for name in experiment.learners)


def test_times_stay_with_their_demonstrations(
    open_bag: OpenBag, experiment: Experiment, entries: list[Entry], tmp_path: Path
) -> None:
    write_mcap(tmp_path / "bag.mcap", entries[::-1])
    found, expected = open_bag(experiment, tmp_path / "bag.mcap"), open_bag(experiment)
    for name in experiment.learners:
        for n in range(1, experiment.iterations + 1):
            assert found.time(name, n) == expected.time(name, n)


def test_several_bags_are_one_whether_split_by_learner_or_by_time(
    experiment: Experiment, entries: list[Entry], tmp_path: Path, open_bag: OpenBag
) -> None:
    parts = {"first": entries[::2], "second": entries[1::2], "early": entries[:5], "late": entries[5:]}
    for name, part in parts.items():
        write_mcap(tmp_path / f"{name}.mcap", part)
    expected = content(open_bag(experiment), experiment)
    for names in (("first", "second"), ("late", "early")):
        bags = [tmp_path / f"{name}.mcap" for name in names]
        with DemonstrationBag(bags, build_game(experiment), experiment.learners) as bag:
            assert content(bag, experiment) == expected


def test_settings_that_decide_no_trajectory_do_not_bind_a_bag(open_bag: OpenBag, experiment: Experiment) -> None:
    expected = content(open_bag(experiment), experiment)
    for change in ({"discount": 0.5}, {"step_cost": 7.0}, {"joint_scale": 3.0}, {"deadline": 5}):
        game = experiment.game.model_copy(update=change)
        assert content(open_bag(experiment.model_copy(update={"game": game})), experiment) == expected


def test_the_head_of_a_demonstration_is_what_the_middleware_reads(entries: list[Entry]) -> None:
    for entry in entries:
        for frame in ("", "a", "map", "frames"):
            entry.message.header.frame_id = frame
            head = demonstration_head(serialize_message(entry.message))
            assert head == (entry.message.learner, entry.message.iteration, entry.message.game_digest)


def refusal(open_bag: OpenBag, experiment: Experiment, bag: Path) -> str:
    with pytest.raises(BagError) as refused:
        open_bag(experiment, bag)
    return str(refused.value)


def test_repetitions_that_differ_are_refused(
    open_bag: OpenBag, experiment: Experiment, entries: list[Entry], tmp_path: Path
) -> None:
    write_mcap(tmp_path / "early.mcap", entries[:4])
    entries[2].message.states[0] += 1.0
    write_mcap(tmp_path / "late.mcap", entries)
    with pytest.raises(BagError, match=r"late\.mcap: topic /learner_1/demonstration: iteration 2: is there several"):
        DemonstrationBag([tmp_path / "early.mcap", tmp_path / "late.mcap"], build_game(experiment), experiment.learners)


def test_sqlite_is_refused_with_its_remedy(
    open_bag: OpenBag, experiment: Experiment, entries: list[Entry], tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    write_rosbags(bag, entries, storage=StoragePlugin.SQLITE3)
    remedy = "rosbags-convert --src BAG --dst NEW --dst-storage mcap"
    assert remedy in refusal(open_bag, experiment, bag)
    (bag / "metadata.yaml").unlink()
    assert remedy in refusal(open_bag, experiment, bag)
    (file,) = bag.glob("*.db3")
    assert remedy in refusal(open_bag, experiment, file)
    assert f"{file}: storage 'sqlite3', expected 'mcap'" in refusal(open_bag, experiment, file)


@pytest.mark.parametrize("where", ["bag_0.mcap", "metadata.yaml"])
def test_pointers_of_git_lfs_are_named(open_bag: OpenBag, experiment: Experiment, tmp_path: Path, where: str) -> None:
    write_metadata(tmp_path, relative_file_paths=["bag_0.mcap"])
    text = "version https://git-lfs.github.com/spec/v1\noid sha256:" + "0" * 64 + "\nsize 12345\n"
    (tmp_path / where).write_text(text, encoding="ascii")
    told = refusal(open_bag, experiment, tmp_path)
    assert f"{where}: is a pointer of Git LFS" in told
    assert "git lfs pull" in told


def test_topics_that_are_there_are_named_where_the_wanted_one_is_not(
    open_bag: OpenBag, experiment: Experiment, entries: list[Entry], tmp_path: Path
) -> None:
    named = [entry._replace(topic=entry.topic.replace("learner", "patroller")) for entry in entries]
    write_mcap(tmp_path / "a.mcap", named, others=10)
    told = refusal(open_bag, experiment, tmp_path / "a.mcap")
    assert "topic /learner_1/demonstration: 0 demonstrations, expected at least 1" in told
    assert "the bag has /odometry (12), /patroller_1/demonstration (6), /patroller_2/demonstration (6)" in told


def test_an_empty_directory_and_a_text_are_no_bags(open_bag: OpenBag, experiment: Experiment, tmp_path: Path) -> None:
    assert "has neither metadata.yaml nor .mcap files" in refusal(open_bag, experiment, tmp_path)
    (tmp_path / "notes.txt").write_text("these are notes", encoding="ascii")
    told = refusal(open_bag, experiment, tmp_path / "notes.txt")
    assert "notes.txt: begins with 'these ar', not as an MCAP file does" in told


def test_compression_that_is_cut_short_is_named(
    open_bag: OpenBag, experiment: Experiment, entries: list[Entry], tmp_path: Path
) -> None:
    VARIANTS["zstd files"](tmp_path / "bag", entries)
    (file,) = (tmp_path / "bag").glob("*.zstd")
    file.write_bytes(file.read_bytes()[:-100])
    assert str(file) in refusal(open_bag, experiment, tmp_path / "bag")


def test_statistics_that_name_more_than_there_is_are_refused(
    open_bag: OpenBag, experiment: Experiment, entries: list[Entry], tmp_path: Path
) -> None:
    """An index that hides a chunk would else cost demonstrations at the end without a word."""
    write_mcap(tmp_path / "a.mcap", entries, ZSTD._replace(options={"enable_crcs": False, "use_chunking": False}))
    content = (tmp_path / "a.mcap").read_bytes()
    count = (1).to_bytes(2, "little") + (6).to_bytes(8, "little")
    assert content.count(count) == 1
    (tmp_path / "a.mcap").write_bytes(content.replace(count, count[:2] + (7).to_bytes(8, "little")))
    assert "6 messages of /learner_1/demonstration, of which its statistics name 7" in refusal(
        open_bag, experiment, tmp_path / "a.mcap"
    )
