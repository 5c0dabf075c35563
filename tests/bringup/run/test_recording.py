"""The recording of a run survives full disks, removed files and killed processes."""

import errno
from pathlib import Path
from typing import Any

import pytest
from mabirds_msgs.msg import Membership
from rosbags.rosbag2 import Reader

from mabirds_bringup.run import recording
from mabirds_bringup.run.recording import Recording
from mabirds_msgs_py.bag_writer import BagWriter


def count(bag: Path) -> int:
    with Reader(bag) as reader:
        return reader.message_count


def fill(target: Any, messages: int) -> None:
    for n in range(messages):
        target.write("/membership", Membership(epoch=n), n)


def test_a_long_recording_is_several_bags(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "MESSAGES", 10)
    with Recording(tmp_path) as target:
        fill(target, 25)
    assert [count(tmp_path / name) for name in ("bag", "bag_2", "bag_3")] == [10, 10, 5]
    assert target.news == []


def test_a_bag_without_an_end_is_repaired_when_a_run_goes_on(tmp_path: Path) -> None:
    killed = BagWriter(tmp_path / "bag", keep=True)
    fill(killed, 2000)
    killed._stream.flush()  # the rest is lost with the process
    with Recording(tmp_path) as target:
        fill(target, 3)
    assert target.news == []
    assert 0 < count(tmp_path / "bag") <= 2000
    assert count(tmp_path / "bag_2") == 3
    killed._stream.close()


def test_a_bag_without_a_byte_is_removed_when_a_run_goes_on(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").touch()
    with Recording(tmp_path) as target:
        fill(target, 3)
    assert target.news == []
    assert count(tmp_path / "bag") == 3


def test_learning_goes_on_where_a_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "AGAIN", 0.0)
    full = True

    def write(self: BagWriter, *arguments: Any) -> None:
        if full:
            raise OSError(errno.ENOSPC, "No space left on device")
        before(self, *arguments)

    before = BagWriter.write
    monkeypatch.setattr(BagWriter, "write", write)
    with Recording(tmp_path) as target:
        fill(target, 1)
        assert f"{tmp_path}/bag: the recording fails (No space left on device); learning goes on" in target.news[0]
        full = False
        fill(target, 4)
    assert count(tmp_path / "bag_2") == 4


def test_a_removed_recording_is_said_and_begun_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import shutil

    monkeypatch.setattr(recording, "AGAIN", 0.0)
    with Recording(tmp_path) as target:
        fill(target, 1)
        shutil.rmtree(tmp_path / "bag")
        fill(target, 3)
    assert "the recording fails (its file was removed)" in target.news[0]
    assert count(tmp_path / "bag") == 2
