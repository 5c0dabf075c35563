"""Bags: what is written is read back, by this project and by an independent reader; damage is named, not played."""

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from mabirds_msgs.msg import Demonstration, EdgeSchedule, LearnerStatus, Parameters
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.games.interface import Trajectories
from mabirds_expert_player.recorder import FIRST_STAMP, record
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.conversion import demonstration_message
from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.interfaces import type_hash, type_name

MESSAGES = Path(__file__).resolve().parents[2] / "ros_ws" / "src" / "mabirds_msgs" / "msg"


OpenBag = Callable[..., DemonstrationBag]


def mcap_file(experiment: Experiment) -> Path:
    return next(experiment.demonstrations.bag.glob("*.mcap"))


def independent_types() -> Typestore:
    """The messages as the independent library reads them, from their sources."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for file in MESSAGES.glob("*.msg"):
        store.register(get_types_from_msg(file.read_text(encoding="utf-8"), f"mabirds_msgs/msg/{file.stem}"))
    return store


def test_a_bag_holds_each_learners_demonstrations_in_order(open_bag: OpenBag, experiment: Experiment) -> None:
    bag = open_bag(experiment)
    for learner in experiment.learners:
        assert bag.count(learner) == experiment.iterations
        for iteration in range(1, experiment.iterations + 1):
            message = bag.message(learner, iteration)
            assert (message.learner, message.iteration) == (learner, iteration)
            assert bag.time(learner, iteration) == FIRST_STAMP + (iteration - 1) * 1_000_000_000


def test_learners_have_different_demonstrations(open_bag: OpenBag, experiment: Experiment) -> None:
    bag = open_bag(experiment)
    first, second = ([tuple(one.actions[0]) for one in bag.trajectories(learner)] for learner in experiment.learners)
    assert first != second


def test_the_same_seed_records_the_same_messages(open_bag: OpenBag, experiment: Experiment, tmp_path: Path) -> None:
    record(experiment, tmp_path / "again")
    one, other = open_bag(experiment), open_bag(experiment, tmp_path / "again")
    for learner in experiment.learners:
        for iteration in range(1, experiment.iterations + 1):
            assert one.message(learner, iteration) == other.message(learner, iteration)


def test_the_committed_patrol_bag_is_what_the_experiment_records(open_bag: OpenBag, tmp_path: Path) -> None:
    experiment = load_experiment(MESSAGES.parents[2] / "config" / "patrol.yaml")
    record(experiment, tmp_path / "again")
    committed, again = open_bag(experiment), open_bag(experiment, tmp_path / "again")
    for learner in experiment.learners:
        assert committed.count(learner) == again.count(learner) == 40
        for iteration in range(1, 41):
            assert committed.message(learner, iteration) == again.message(learner, iteration)


def test_an_independent_reader_reads_the_same(open_bag: OpenBag, experiment: Experiment) -> None:
    own, store = open_bag(experiment), independent_types()
    with Reader(experiment.demonstrations.bag) as reader:
        seen = 0
        for connection, time, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            learner = connection.topic.split("/")[1]
            expected = own.message(learner, message.iteration)
            assert time == own.time(learner, message.iteration)
            assert message.states.tolist() == list(expected.states)
            assert message.actions.tolist() == list(expected.actions)
            assert message.game_digest == expected.game_digest
            seen += 1
    assert seen == len(experiment.learners) * experiment.iterations


@pytest.mark.parametrize("message_type", [Demonstration, Parameters, LearnerStatus, EdgeSchedule])
def test_type_hashes_agree_with_an_independent_computation(message_type: type) -> None:
    assert independent_types().hash_rihs01(type_name(message_type)) == type_hash(message_type)


def test_metadata_names_version_storage_and_type_hash(experiment: Experiment) -> None:
    text = (experiment.demonstrations.bag / "metadata.yaml").read_text(encoding="utf-8")
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert (information["version"], information["storage_identifier"]) == (9, "mcap")
    topics = [entry["topic_metadata"] for entry in information["topics_with_message_count"]]
    assert [topic["name"] for topic in topics] == [f"/{name}/demonstration" for name in experiment.learners]
    assert {topic["type_description_hash"] for topic in topics} == {type_hash(Demonstration)}


def test_every_flipped_byte_is_an_error_or_changes_nothing(open_bag: OpenBag, experiment: Experiment) -> None:
    """Every 37th byte of the file, all regions: no damage passes as other demonstrations, none crashes."""
    file, intact = mcap_file(experiment), open_bag(experiment)
    original = file.read_bytes()
    undetected = []
    for place in range(0, len(original), 37):
        file.write_bytes(flip(original, place))
        with suppress(BagError):
            damaged = open_bag(experiment)
            undetected.append(place)
            assert all(
                damaged.message(name, n) == intact.message(name, n)
                for name in experiment.learners
                for n in range(1, experiment.iterations + 1)
            )
    file.write_bytes(original)
    assert len(undetected) < 0.05 * len(original) / 37


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_bag_is_refused(open_bag: OpenBag, experiment: Experiment, share: float) -> None:
    file = mcap_file(experiment)
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(BagError, match=f"{file.name}.*fetch it again or record it anew"):
        open_bag(experiment)


@pytest.fixture
def long_bag(make_experiment: Callable[..., Path]) -> Experiment:
    """An experiment whose bag has several chunks."""
    return load_experiment(make_experiment(iterations=60))


def intact_up_to(error: BagError) -> list[int]:
    found = re.findall(r"topic /learner_\d/demonstration: iteration (\d+)", str(error))
    return [int(iteration) for iteration in found]


def flip(content: bytes, place: int) -> bytes:
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


@pytest.mark.parametrize("spoil", [flip, lambda content, place: content[:place]], ids=["flipped bit", "truncated"])
def test_damage_is_named_by_file_topic_and_last_intact_iteration(
    open_bag: OpenBag, long_bag: Experiment, spoil: Callable[[bytes, int], bytes]
) -> None:
    file = mcap_file(long_bag)
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[len(summary.chunk_indexes) // 2]
    file.write_bytes(spoil(file.read_bytes(), chunk.chunk_start_offset + chunk.chunk_length // 2))
    with pytest.raises(BagError, match=file.name) as damage:
        open_bag(long_bag)
    first, second = intact_up_to(damage.value)
    assert 0 < first < 60
    assert 0 < second < 60


def test_bytes_after_the_end_are_refused(open_bag: OpenBag, experiment: Experiment) -> None:
    file = mcap_file(experiment)
    file.write_bytes(file.read_bytes() + b"more")
    with pytest.raises(BagError, match="bytes after the end"):
        open_bag(experiment)


def test_a_bag_of_another_game_is_refused(open_bag: OpenBag, experiment: Experiment) -> None:
    other = experiment.model_copy(update={"game": experiment.game.model_copy(update={"horizon": 9})})
    with pytest.raises(
        BagError,
        match="topic /learner_1/demonstration: iteration 1: game digest '.*', expected .*; the bag is of another",
    ):
        open_bag(other)


def test_a_bag_without_a_learner_is_refused(open_bag: OpenBag, experiment: Experiment) -> None:
    other = experiment.model_copy(update={"learners": ("learner_1", "learner_9")})
    with pytest.raises(BagError, match="topic /learner_9/demonstration: 0 demonstrations, expected at least 1"):
        open_bag(other)


def test_a_missing_bag_is_named(open_bag: OpenBag, experiment: Experiment, tmp_path: Path) -> None:
    with pytest.raises(BagError, match="nowhere.*give the directory of a rosbag2 bag"):
        open_bag(experiment, tmp_path / "nowhere")


def test_metadata_that_is_none_is_refused(open_bag: OpenBag, experiment: Experiment) -> None:
    (experiment.demonstrations.bag / "metadata.yaml").write_text("- just\n- a list\n", encoding="utf-8")
    with pytest.raises(BagError, match=r"metadata\.yaml: is not the metadata of a rosbag2 bag"):
        open_bag(experiment)


def write_demonstrations(directory: Path, messages: list[Demonstration]) -> None:
    with BagWriter(directory) as bag:
        for time, message in enumerate(messages):
            bag.write(f"/{message.learner}/demonstration", message, time)


def some_messages(open_bag: OpenBag, experiment: Experiment) -> list[Demonstration]:
    bag = open_bag(experiment)
    return [bag.message("learner_1", iteration) for iteration in (1, 2, 3)]


def test_an_impossible_transition_is_named(open_bag: OpenBag, experiment: Experiment, tmp_path: Path) -> None:
    messages = some_messages(open_bag, experiment)
    messages[1].states[8] = 2.0  # expert 1's row at step 2
    messages[1].states[9] = 2.0
    write_demonstrations(tmp_path / "odd", messages)
    one = experiment.model_copy(update={"learners": ("learner_1",)})
    with pytest.raises(
        BagError, match=r"odd_0\.mcap: topic /learner_1/demonstration: iteration 2: step 1: expert 1 moves \w+ from"
    ):
        open_bag(one, tmp_path / "odd")


def test_a_gap_in_the_iterations_is_named(open_bag: OpenBag, experiment: Experiment, tmp_path: Path) -> None:
    messages = some_messages(open_bag, experiment)
    write_demonstrations(tmp_path / "gap", [messages[0], messages[2]])
    one = experiment.model_copy(update={"learners": ("learner_1",)})
    with pytest.raises(BagError, match="iteration 3: expected iteration 2"):
        open_bag(one, tmp_path / "gap")


def test_messages_of_another_type_are_refused(open_bag: OpenBag, experiment: Experiment, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "other") as bag:
        bag.write("/learner_1/demonstration", EdgeSchedule(digest="x"), 1)
    one = experiment.model_copy(update={"learners": ("learner_1",)})
    with pytest.raises(BagError, match="type mabirds_msgs/msg/EdgeSchedule .* expected mabirds_msgs/msg/Demonstration"):
        open_bag(one, tmp_path / "other")


def test_an_existing_directory_is_not_overwritten(experiment: Experiment) -> None:
    before = mcap_file(experiment).read_bytes()
    with pytest.raises(BagError, match="exists already"):
        record(experiment, experiment.demonstrations.bag)
    assert mcap_file(experiment).read_bytes() == before


def test_a_recording_that_fails_leaves_nothing_behind(tmp_path: Path) -> None:
    def fail() -> None:
        with BagWriter(tmp_path / "bag") as bag:
            bag.write("/a", EdgeSchedule(digest="x"), 1)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert not (tmp_path / "bag").exists()


def test_demonstrations_survive_the_round_trip(open_bag: OpenBag, experiment: Experiment, tmp_path: Path) -> None:
    game = build_game(experiment)
    original = list(open_bag(experiment).trajectories("learner_1"))
    messages = [demonstration_message(game, "learner_1", n + 1, one, n) for n, one in enumerate(original)]
    write_demonstrations(tmp_path / "copy", messages)
    one = experiment.model_copy(update={"learners": ("learner_1",)})
    copies: list[Trajectories] = list(open_bag(one, tmp_path / "copy").trajectories("learner_1"))
    assert [c.states.tolist() for c in copies] == [o.states.tolist() for o in original]
    assert [c.actions.tolist() for c in copies] == [o.actions.tolist() for o in original]
