"""Checkpoints: whole or refused in words, of the right learner and run, on the disk before anybody hears of them."""

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
from safetensors.numpy import save_file

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError
from mabirds_learner.checkpoint import (
    CheckpointMetadata,
    CheckpointStore,
    newest_checkpoint,
    newest_of_anybody,
    owner_of,
)
from mabirds_learner.records import HEAD, HEADER

OWNER = CheckpointMetadata("learner_1", "experiment", "schedule")
LIKE = Parameters(np.zeros(5), np.zeros(3))


def arrays(iteration: int) -> dict[str, Array]:
    return {"theta": np.arange(5.0) + iteration, "omega": np.array([-0.0, 1e-300, iteration])}


def whole(iteration: int) -> dict[str, Array]:
    return {**arrays(iteration), "policy.replay": np.full(100, float(iteration)), "mixed_from": np.zeros(1)}


def reopened(directory: Path, owner: CheckpointMetadata = OWNER, keep: int = 4) -> CheckpointStore:
    return CheckpointStore(directory, owner, LIKE, keep)


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """Checkpoints of iterations 1 to 6."""
    store = reopened(tmp_path / "learner_1")
    for iteration in range(1, 7):
        store.save(iteration, whole(iteration))
    store.close()
    return tmp_path / "learner_1"


def record(directory: Path, iteration: int) -> int:
    """Where the record of an iteration begins: all are of one size."""
    content = (directory / "journal").read_bytes()
    _, _, size, _ = HEAD.unpack_from(content, HEADER)
    return HEADER + (iteration - 1) * (HEAD.size + int(size))


def same(found: dict[str, Array], expected: dict[str, Array]) -> bool:
    return {name: values.tobytes() for name, values in found.items()} == {
        name: values.tobytes() for name, values in expected.items()
    }


def test_the_newest_three_come_back_whole_and_of_others_what_neighbours_may_ask_for(directory: Path) -> None:
    found = reopened(directory).load()
    assert list(found) == [3, 4, 5, 6]
    assert same(found[3], arrays(3))
    assert all(same(found[n], whole(n)) for n in (4, 5, 6))


@pytest.mark.parametrize("keep", [1, 2, 3, 4, 5, 10])
def test_as_many_stay_as_were_asked_for_and_three_of_them_whole(directory: Path, keep: int) -> None:
    found = {n: "mixed_from" in content for n, content in reopened(directory, keep=keep).load().items()}
    assert found == {n: n > 3 for n in range(max(1, 7 - keep), 7)}


def test_all_iterations_are_in_the_log_beside(directory: Path) -> None:
    store = reopened(directory)
    assert list(store.parameters) == [1, 2, 3, 4, 5, 6]
    assert same(dict(store.parameters[1]._asdict()), arrays(1))


def test_a_power_cut_may_take_the_log_and_the_journal_makes_up_for_it(directory: Path) -> None:
    content = bytearray((directory / "parameters.log").read_bytes())
    content[HEADER:] = bytes(len(content) - HEADER)
    (directory / "parameters.log").write_bytes(content)
    assert list(reopened(directory).parameters) == [1, 2, 3, 4, 5, 6]


def test_the_log_is_on_the_disk_before_the_journal_lets_go(directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first record after a start begins the journal anew."""
    synchronised, synchronise = list[str](), os.fdatasync

    def note(descriptor: int) -> None:
        synchronised.append(Path(f"/proc/self/fd/{descriptor}").resolve().name)
        synchronise(descriptor)

    store = reopened(directory)
    monkeypatch.setattr(os, "fdatasync", note)
    store.save(7, whole(7))
    assert synchronised == ["parameters.log", "journal.unfinished"]
    store.save(8, whole(8))
    assert synchronised[2:] == ["journal"]


def test_an_empty_directory_has_none(tmp_path: Path) -> None:
    store = reopened(tmp_path / "several" / "new" / "ones")
    assert (store.load(), store.refused) == ({}, [])
    assert newest_checkpoint(store.directory, OWNER) is None


def test_a_state_that_is_saved_again_counts_as_it_was_last(directory: Path) -> None:
    """As a resilient learner does where an epoch begins."""
    store = reopened(directory)
    store.save(6, whole(60))
    assert same(store.load()[6], whole(60))
    assert same(dict(store.parameters[6]._asdict()), arrays(60))
    store.close()
    assert same(reopened(directory).load()[6], whole(60))


def flipped(directory: Path) -> None:
    content = bytearray((directory / "journal").read_bytes())
    content[record(directory, 6) + 100] ^= 4
    (directory / "journal").write_bytes(content)


def torn(directory: Path) -> None:
    os.truncate(directory / "journal", record(directory, 6) + 100)


def unmarked(directory: Path) -> None:
    content = bytearray((directory / "journal").read_bytes())
    content[record(directory, 6)] ^= 4
    (directory / "journal").write_bytes(content)


@pytest.mark.parametrize("damage", [flipped, torn, unmarked])
def test_a_damaged_one_is_told_and_the_previous_one_used(directory: Path, damage: Callable[[Path], None]) -> None:
    damage(directory)
    store = reopened(directory)
    for _ in range(2):
        assert max(store.load()) == 5
        assert store.refused == [
            f"journal: the last record is not whole behind iteration 5 (byte {record(directory, 6)})"
        ]
    store.save(6, whole(6))
    assert list(store.load()) == [3, 4, 5, 6]
    assert store.refused == []


def test_damage_in_the_middle_takes_nothing_of_what_follows(directory: Path) -> None:
    content = bytearray((directory / "journal").read_bytes())
    content[record(directory, 3) + 50] ^= 1
    content[record(directory, 4)] ^= 1
    (directory / "journal").write_bytes(content)
    store = reopened(directory)
    assert list(store.load()) == [3, 4, 5, 6]
    assert store.refused == [f"journal: no whole record behind iteration 2 (byte {record(directory, 3)})"]


def test_a_damaged_header_is_told_and_the_records_are_used(directory: Path) -> None:
    content = bytearray((directory / "journal").read_bytes())
    content[content.index(b"experiment_digest")] ^= 1
    (directory / "journal").write_bytes(content)
    store = reopened(directory)
    assert max(store.load()) == 6
    assert store.refused == ["journal: experiment_digest is None, expected 'experiment'"]


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
    before = {file.name: file.read_bytes() for file in directory.iterdir()}
    with pytest.raises(CheckpointError, match="no checkpoint can be used .*name another directory, or delete") as error:
        reopened(directory, owner)
    assert words in str(error.value)
    with pytest.raises(CheckpointError, match="no checkpoint can be used"):
        newest_checkpoint(directory, owner)
    assert {file.name: file.read_bytes() for file in directory.iterdir()} == before
    assert reopened(directory.with_name("other"), owner).load() == {}


def test_records_of_another_experiment_are_none(directory: Path, tmp_path: Path) -> None:
    other = reopened(tmp_path / "other", replace(OWNER, experiment_digest="elsewhere!"))
    other.save(7, whole(7))
    content, donor = (directory / "journal").read_bytes(), (tmp_path / "other" / "journal").read_bytes()
    end = record(directory, 7)
    size = end - record(directory, 6)
    (directory / "journal").write_bytes(content[:end] + donor[HEADER : HEADER + size] + content[end + size :])
    store = reopened(directory)
    assert max(store.load()) == 6
    assert store.refused == [f"journal: the last record is not whole behind iteration 6 (byte {end})"]


@pytest.mark.parametrize("content", [b"", b"\0" * 4096, b"something else"])
def test_what_is_no_journal_is_refused_and_left_alone(directory: Path, content: bytes) -> None:
    (directory / "journal").write_bytes(content)
    with pytest.raises(CheckpointError, match=r"no checkpoint can be used \(format is None, expected 'mabirds-journal"):
        reopened(directory)
    assert (directory / "journal").read_bytes() == content


def test_files_of_earlier_versions_are_refused(tmp_path: Path) -> None:
    save_file(arrays(7), tmp_path / "00000007.safetensors")
    for read in (reopened, lambda place: newest_checkpoint(place, OWNER)):
        with pytest.raises(CheckpointError, match="00000007.safetensors is of an earlier version.*delete this one"):
            read(tmp_path)


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


def test_the_newest_can_be_read_while_the_learner_writes(directory: Path) -> None:
    store = reopened(directory)
    for iteration in range(7, 60):
        store.save(iteration, whole(iteration))
        found = newest_checkpoint(directory, OWNER)
        assert found
        assert (found[0], same(found[1], whole(iteration))) == (iteration, True)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CheckpointError, match=r"file/learner_1: checkpoints cannot be written \(Not a directory\)"):
        reopened(tmp_path / "file" / "learner_1")


def full(*_: object) -> None:
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize("call", ["fdatasync", "fsync", "pwrite", "posix_fallocate"])
def test_a_full_disk_is_said_and_leaves_what_was_there(
    directory: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """First where the journal is begun anew, and then where a record is put behind others."""
    store = reopened(directory)
    for iteration in (7, 8, 9):
        with monkeypatch.context() as patch:
            patch.setattr(os, call, full)
            if iteration == 7 or call in {"fdatasync", "pwrite"}:
                with pytest.raises(CheckpointError, match=r"cannot be written \(No space left on device\); make room"):
                    store.save(iteration, whole(iteration))
        assert max(store.load()) >= iteration - 1
        store.save(iteration, whole(iteration))
        assert same(store.load()[iteration], whole(iteration))
    store.close()
    assert list(reopened(directory, keep=99).load()) == list(range(1, 10))
    assert sorted(file.name for file in directory.iterdir()) == ["journal", "lock", "parameters.log"]


def test_a_file_whose_synchronisation_failed_is_not_written_to_again(
    directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system may have given up on its pages, and would then say of the next synchronisation that all is well."""
    store = reopened(directory)
    store.save(7, whole(7))
    before = (directory / "journal").stat().st_ino
    with monkeypatch.context() as patch:
        patch.setattr(os, "fdatasync", full)
        with pytest.raises(CheckpointError):
            store.save(8, whole(8))
    store.save(8, whole(8))
    assert (directory / "journal").stat().st_ino != before


def test_no_file_is_left_open(directory: Path) -> None:
    store = reopened(directory)
    store.save(7, whole(7))
    open_before = len(list(Path("/proc/self/fd").iterdir()))
    for iteration in range(8, 80):  # of which the journal has room for 25
        store.save(iteration, {**arrays(iteration), "policy.replay": np.zeros(5000)})
    store.load()
    assert len(list(Path("/proc/self/fd").iterdir())) == open_before
    assert stat.S_ISREG((directory / "journal").stat().st_mode)


WRITER = """
import sys
from pathlib import Path
import numpy as np
from mabirds_core.algorithm.parameters import Parameters
from mabirds_learner.checkpoint import CheckpointMetadata, CheckpointStore
like = Parameters(np.zeros(20_000), np.zeros(1))
store = CheckpointStore(Path(sys.argv[1]), CheckpointMetadata("learner_1", "experiment", "schedule"), like, keep=4)
for iteration in range(1, 100_000):
    store.save(iteration, {"theta": np.full(20_000, float(iteration)), "omega": np.zeros(1)})
    print(iteration, flush=True)
"""


@pytest.mark.parametrize("iterations", [1, 7, 23, 60])
def test_a_killed_writer_leaves_whole_checkpoints_and_never_less_than_it_said(tmp_path: Path, iterations: int) -> None:
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    for _ in range(iterations):
        said = int(writer.stdout.readline())
    writer.send_signal(signal.SIGKILL)
    writer.communicate()
    store = CheckpointStore(tmp_path, OWNER, Parameters(np.zeros(20_000), np.zeros(1)), keep=4)
    found = store.load()
    assert all("the last record is not whole" in words for words in store.refused)
    assert max(found) >= said
    assert all((content["theta"] == n).all() for n, content in found.items())


def test_whose_a_directory_is_can_be_asked_without_knowing(directory: Path, tmp_path: Path) -> None:
    assert owner_of(directory) == OWNER
    found = newest_of_anybody(directory)
    assert found
    assert (found[0], same(found[1], whole(6))) == (6, True)
    assert newest_of_anybody(tmp_path / "nowhere") is None
    (directory / "journal").write_bytes(b"something else")
    assert owner_of(directory) is None
