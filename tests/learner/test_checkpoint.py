"""Checkpoints: whole or refused by name, of the right learner and run, and never half written."""

import fcntl
import os
import signal
import stat
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file

from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError
from mabirds_learner.checkpoint import CheckpointMetadata, CheckpointStore

OWNER = CheckpointMetadata("learner_1", "experiment", "schedule")


def arrays(iteration: int) -> dict[str, Array]:
    return {"theta": np.arange(5.0) + iteration, "omega": np.array([-0.0, 1e-300, iteration])}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """Checkpoints of iterations 1 to 6, of which the last 4 stay."""
    store = CheckpointStore(tmp_path / "learner_1", OWNER, keep=4)
    for iteration in range(1, 7):
        store.save(iteration, arrays(iteration))
    store.close()
    return tmp_path / "learner_1"


def reopened(directory: Path, owner: CheckpointMetadata = OWNER) -> CheckpointStore:
    return CheckpointStore(directory, owner, keep=4)


def test_the_last_iterations_stay_and_come_back_bit_for_bit(directory: Path) -> None:
    assert sorted(file.name for file in directory.glob("*.safetensors")) == [
        f"{n:08}.safetensors" for n in (3, 4, 5, 6)
    ]
    found = reopened(directory).load()
    assert list(found) == [3, 4, 5, 6]
    for iteration, content in found.items():
        assert {name: values.tobytes() for name, values in content.items()} == {
            name: values.tobytes() for name, values in arrays(iteration).items()
        }


def test_the_newest_three_are_whole_and_the_others_keep_what_neighbours_may_ask_for(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path, OWNER, keep=10)
    for iteration in range(1, 7):
        store.save(iteration, {**arrays(iteration), "policy.replay": np.ones(1000), "mixed_from": np.zeros(1)})
    found = store.load()
    assert {n for n, content in found.items() if "policy.replay" in content} == {4, 5, 6}
    for iteration in (1, 2, 3):
        assert found[iteration].keys() == {"theta", "omega"}
        assert found[iteration]["omega"].tobytes() == arrays(iteration)["omega"].tobytes()


def test_a_damaged_older_one_is_left_for_whoever_loads_it(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path, OWNER, keep=10)
    for iteration in range(1, 4):
        store.save(iteration, {**arrays(iteration), "mixed_from": np.zeros(1)})
    cut_short(tmp_path / "00000001.safetensors")
    store.save(4, arrays(4))
    assert list(store.load()) == [2, 3, 4]
    assert "00000001.safetensors: is no whole checkpoint" in store.refused[0]


def test_an_empty_directory_has_none(tmp_path: Path) -> None:
    store = reopened(tmp_path / "several" / "new" / "ones")
    assert store.refused == []
    assert store.load() == {}
    assert store.refused == []


def test_what_is_wrong_is_said_once_however_often_they_are_loaded(directory: Path) -> None:
    for number in (3, 5, 4):
        cut_short(directory / f"0000000{number}.safetensors")
    store = reopened(directory)
    for _ in range(2):
        assert list(store.load()) == [6]
        assert [words[:8] for words in store.refused] == ["00000003", "00000004", "00000005"]


@pytest.mark.parametrize("keep", [1, 2, 3, 4, 5])
def test_as_many_stay_as_were_asked_for_and_three_of_them_whole(tmp_path: Path, keep: int) -> None:
    store = CheckpointStore(tmp_path, OWNER, keep)
    for iteration in range(1, 8):
        store.save(iteration, {**arrays(iteration), "mixed_from": np.zeros(1)})
    whole = {n: "mixed_from" in content for n, content in store.load().items()}
    assert whole == {n: n > 4 for n in range(8 - keep, 8)}


def test_what_is_saved_is_on_the_disk_before_it_has_its_name(directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Content first, then its place in the directory; and no file is left open."""
    synced, sync, target = [], os.fsync, directory / "00000007.safetensors"

    def record(descriptor: int) -> None:
        status = os.fstat(descriptor)
        synced.append((stat.S_ISDIR(status.st_mode), status.st_ino, status.st_size, target.exists()))
        sync(descriptor)

    store = CheckpointStore(directory, OWNER, keep=10)
    open_before = len(list(Path("/proc/self/fd").iterdir()))
    monkeypatch.setattr(os, "fsync", record)
    store.save(7, arrays(7))
    assert len(list(Path("/proc/self/fd").iterdir())) == open_before
    (is_directory, number, size, named), (is_directory_then, directory_number, _, named_then) = synced
    assert (is_directory, number, size, named) == (False, target.stat().st_ino, target.stat().st_size, False)
    assert (is_directory_then, directory_number, named_then) == (True, directory.stat().st_ino, True)


def test_a_file_that_does_not_say_whose_it_is_is_refused(directory: Path) -> None:
    save_file(arrays(7), directory / "00000007.safetensors")
    store = reopened(directory)
    assert max(store.load()) == 6
    assert store.refused == ["00000007.safetensors: format is None, expected 'mabirds-checkpoint-1'"]


@pytest.mark.parametrize(
    "changed",
    [
        {"theta": np.arange(5.0).reshape(5, 1), "omega": np.ones(3)},
        {"theta": np.arange(5.0).view(np.int64), "omega": np.ones(3)},
        {"omega": np.arange(5.0), "theta": np.ones(3)},
        {"theta": np.arange(5.0), "omega": np.ones(3), "policy": np.empty(0)},
    ],
    ids=["shape", "type", "names", "one more"],
)
def test_the_same_numbers_as_something_else_are_noticed(tmp_path: Path, changed: dict[str, Array]) -> None:
    store = reopened(tmp_path)
    store.save(1, {"theta": np.arange(5.0), "omega": np.ones(3)})
    with safe_open(tmp_path / "00000001.safetensors", framework="numpy") as content:
        metadata = content.metadata()
    save_file(changed, tmp_path / "00000001.safetensors", metadata)
    with pytest.raises(CheckpointError, match="00000001.safetensors: sha256 is "):
        store.load()


def cut_short(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-3])


def emptied(file: Path) -> None:
    file.write_bytes(b"")


def one_bit_flipped(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[-10] ^= 4
    file.write_bytes(content)


def renamed(file: Path) -> None:
    file.rename(file.with_name("00000099.safetensors"))


def not_numbered(file: Path) -> None:
    file.rename(file.with_name("newest.safetensors"))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (cut_short, "00000006.safetensors: is no whole checkpoint"),
        (emptied, "00000006.safetensors: is no whole checkpoint"),
        (one_bit_flipped, "00000006.safetensors: sha256 is '"),
        (renamed, "00000099.safetensors: iteration is '6', expected '99'"),
        (not_numbered, "newest.safetensors: iteration is '6', expected '0'"),
    ],
)
def test_a_damaged_one_is_refused_by_name_and_the_previous_one_used(
    directory: Path, damage: Callable[[Path], None], words: str
) -> None:
    damage(directory / "00000006.safetensors")
    store = reopened(directory)
    assert max(store.load()) == 5
    assert len(store.refused) == 1
    assert store.refused[0].startswith(words)


@pytest.mark.parametrize(
    ("owner", "words"),
    [
        (replace(OWNER, learner="learner_2"), "learner is 'learner_1', expected 'learner_2'"),
        (replace(OWNER, experiment_digest="other"), "experiment_digest is 'experiment', expected 'other'"),
        (replace(OWNER, schedule_digest="other"), "schedule_digest is 'schedule', expected 'other'"),
    ],
)
def test_a_directory_of_somebody_else_is_refused_as_a_whole(
    directory: Path, owner: CheckpointMetadata, words: str
) -> None:
    with pytest.raises(CheckpointError, match="no checkpoint can be used .*name another directory, or delete") as error:
        reopened(directory, owner).load()
    assert words in str(error.value)
    assert reopened(directory.with_name("other"), owner).load() == {}


def test_one_of_another_experiment_among_others_is_refused_by_name(directory: Path, tmp_path: Path) -> None:
    other = CheckpointStore(tmp_path / "other", replace(OWNER, experiment_digest="other"), keep=4)
    other.save(7, arrays(7))
    (tmp_path / "other" / "00000007.safetensors").rename(directory / "00000007.safetensors")
    store = reopened(directory)
    assert max(store.load()) == 6
    assert store.refused == ["00000007.safetensors: experiment_digest is 'other', expected 'experiment'"]


def test_flipped_bytes_are_noticed_wherever_they_are(directory: Path) -> None:
    file = directory / "00000006.safetensors"
    intact, store = file.read_bytes(), reopened(directory)
    for place in range(0, len(intact), 7):
        file.write_bytes(intact[:place] + bytes([intact[place] ^ 255]) + intact[place + 1 :])
        found = store.load().get(6, arrays(6))
        assert all(values.tobytes() == found[name].tobytes() for name, values in arrays(6).items()), place


def test_two_processes_cannot_share_a_directory(directory: Path) -> None:
    first = reopened(directory)
    with pytest.raises(CheckpointError, match="another process writes its checkpoints here; end the other learner_1"):
        reopened(directory)
    first.close()
    reopened(directory)


def test_the_lock_is_the_file_that_other_versions_lock(tmp_path: Path) -> None:
    descriptor = os.open(tmp_path / "lock", os.O_WRONLY | os.O_CREAT)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    with pytest.raises(CheckpointError, match="another process writes its checkpoints here"):
        reopened(tmp_path)
    os.close(descriptor)
    reopened(tmp_path)


def test_what_a_killed_process_left_unfinished_is_removed(directory: Path) -> None:
    (directory / "00000007.unfinished").write_bytes(b"half of it")
    (directory / "notes.txt").touch()
    reopened(directory)
    assert not (directory / "00000007.unfinished").exists()
    assert (directory / "notes.txt").exists()


def test_they_come_in_the_order_of_iterations_whatever_their_files_names(tmp_path: Path) -> None:
    store = reopened(tmp_path)
    for iteration in (99_999_999, 100_000_000):
        store.save(iteration, arrays(iteration))
    assert list(store.load()) == [99_999_999, 100_000_000]


def test_where_none_is_sound_the_newest_is_named(directory: Path) -> None:
    for number in (3, 4, 5, 6):
        cut_short(directory / f"0000000{number}.safetensors")
    with pytest.raises(CheckpointError, match=r"no checkpoint can be used \(00000006.safetensors: is no whole"):
        reopened(directory).load()


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CheckpointError, match=r"file/learner_1: checkpoints cannot be written \(Not a directory\)"):
        reopened(tmp_path / "file" / "learner_1")


def test_a_full_disk_is_said_and_leaves_what_was_there(directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    store = reopened(directory)
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(CheckpointError, match=r"cannot be written \(No space left on device\); make room"):
        store.save(7, arrays(7))
    store.close()
    assert max(reopened(directory).load()) == 6
    assert not list(directory.glob("*.unfinished"))


WRITER = """
import sys
from pathlib import Path
import numpy as np
from mabirds_learner.checkpoint import CheckpointMetadata, CheckpointStore
store = CheckpointStore(Path(sys.argv[1]), CheckpointMetadata("learner_1", "experiment", "schedule"), keep=4)
for iteration in range(1, 100_000):
    store.save(iteration, {"theta": np.full(20_000, float(iteration))})
    print(iteration, flush=True)
"""


@pytest.mark.parametrize("iterations", [1, 7, 23])
def test_a_killed_writer_leaves_whole_checkpoints_and_never_less_than_it_said(tmp_path: Path, iterations: int) -> None:
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    for _ in range(iterations):
        said = int(writer.stdout.readline())
    writer.send_signal(signal.SIGKILL)
    writer.communicate()
    store = reopened(tmp_path)
    found = store.load()
    assert store.refused == []
    assert max(found) >= said
    assert (found[max(found)]["theta"] == max(found)).all()
