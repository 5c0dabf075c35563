"""Journals: whatever is cut off, torn or interrupted, what was said to be on the disk is there."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mabirds_learner import journal as module
from mabirds_learner.journal import COMPLETE, ROOM, Journal, read_journal
from mabirds_learner.records import HEADER, Format

OWNER = "format test\nlearner learner_1\n"
CONTENTS = [b"", b"a", bytes(100), os.urandom(300), b"mabirds\x01" * 20]


def known(file: Path) -> list[tuple[int, bytes]]:
    return [(n, bytes(content)) for n, content in read_journal(file, OWNER).records]


def written(file: Path) -> list[int]:
    """Where the records of ``CONTENTS`` end; their iterations are 1, 2, ..."""
    journal, ends, layout = Journal(file, OWNER), [HEADER], Format(OWNER)
    for n, content in enumerate(CONTENTS, start=1):
        journal.append(n, content)
        ends.append(ends[-1] + len(layout.pack(n, content)))
    journal.close()
    return ends


@pytest.mark.parametrize("tail", ["cut off", "never written"])
def test_a_record_that_is_torn_at_any_byte_takes_no_other_with_it(tmp_path: Path, tail: str) -> None:
    """What a killed process or a power cut leaves: the first bytes of a record, and room behind it or none."""
    file = tmp_path / "journal"
    ends = written(file)
    content, expected = file.read_bytes(), list(enumerate(CONTENTS, start=1))
    for place in range(HEADER, ends[-1] + 1):
        file.write_bytes(content[:place] + (bytes(len(content) - place) if tail == "never written" else b""))
        found = read_journal(file, OWNER)
        whole = sum(end <= place for end in ends) - 1
        records = [(n, bytes(piece)) for n, piece in found.records]
        assert records[:whole] == expected[:whole]
        if len(records) > whole:  # the rest of the record was nothing but zeros
            assert tail == "never written"
            assert records == expected[: whole + 1]
            assert not content[place : ends[whole + 1]].strip(b"\0")
        assert len(found.damaged) <= 1


def test_pages_of_a_torn_record_may_reach_the_disk_in_any_order(tmp_path: Path) -> None:
    file = tmp_path / "journal"
    ends = written(file)
    content = file.read_bytes()
    for place in range(ends[3], ends[4]):
        file.write_bytes(content[: ends[3]] + bytes(place - ends[3]) + content[place : ends[4]] + bytes(ROOM))
        assert known(file)[:3] == list(enumerate(CONTENTS[:3], start=1))
        assert len(known(file)) == (4 if content[ends[3] : place].strip(b"\0") == b"" else 3)


def test_a_flipped_byte_costs_the_record_that_it_is_in_and_is_told(tmp_path: Path) -> None:
    file = tmp_path / "journal"
    ends = written(file)
    content = file.read_bytes()
    for place in range(HEADER, ends[-1]):
        file.write_bytes(content[:place] + bytes([content[place] ^ 255]) + content[place + 1 :])
        damaged = sum(end <= place for end in ends)
        assert [n for n, _ in known(file)] == [n for n in range(1, 6) if n != damaged]
        assert len(read_journal(file, OWNER).damaged) == 1


class InterruptedAnywhereError(Exception):
    """Stands for the end of the process."""


class Call(NamedTuple):
    """A call of the system that changes a file, the names of files, or what is on the disk."""

    module: Any
    name: str


CALLS = (
    Call(os, "pwrite"),
    Call(os, "fdatasync"),
    Call(os, "fsync"),
    Call(os, "posix_fallocate"),
    Call(Path, "replace"),
)


def interrupt(patch: pytest.MonkeyPatch, at: int, *, before: bool) -> None:
    """Raise at a call of the system, before or after it is done."""
    count = 0

    def wrapped(original: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            nonlocal count
            count += 1
            if count == at and before:
                raise InterruptedAnywhereError
            result = original(*arguments)
            if count == at:
                raise InterruptedAnywhereError
            return result

        return call

    for place, name in CALLS:
        patch.setattr(place, name, wrapped(getattr(place, name)))


@pytest.mark.parametrize("before", [True, False])
def test_a_process_that_ends_at_any_call_of_the_system_leaves_what_it_had_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, before: bool
) -> None:
    """Of the first file, of records behind others, and of writing anew, until all goes through undisturbed."""
    monkeypatch.setattr(module, "ROOM", 0)
    monkeypatch.setattr(module, "RECORDS", 2)
    for at in range(1, 100):
        file, said = tmp_path / f"{at}" / "journal", 0
        file.parent.mkdir()
        journal = Journal(file, OWNER)
        try:
            with monkeypatch.context() as patch:
                interrupt(patch, at, before=before)
                for n in range(1, 11):
                    journal.append(n, bytes([n]) * 50)
                    said = n
        except InterruptedAnywhereError:
            pass
        records = known(file) if file.exists() else []
        numbers = [n for n, _ in records]
        assert numbers[-1:] in ([said] * bool(said), [said + 1])
        assert numbers == list(range(numbers[0], numbers[-1] + 1)) if numbers else said == 0
        assert len(numbers) >= min(said, COMPLETE)
        again = Journal(file, OWNER)
        again.go_on_behind(read_journal(file, OWNER).records if file.exists() else [])
        again.append(99, b"further")
        assert known(file) == [*records[1 - COMPLETE :], (99, b"further")]
        assert [name.name for name in file.parent.iterdir()] == ["journal"]
        if said == 10:
            assert at > 20
            return
    pytest.fail("never went through")


def test_a_full_one_is_written_anew_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done, file = list[tuple[str, str]](), tmp_path / "journal"

    def note(name: str, original: Callable[..., Any]) -> Callable[..., Any]:
        def call(what: Any, *arguments: Any) -> Any:
            path = what if isinstance(what, Path) else Path(f"/proc/self/fd/{what}").resolve()
            done.append((name, path.name))
            return original(what, *arguments)

        return call

    for place, name in CALLS:
        monkeypatch.setattr(place, name, note(name, getattr(place, name)))
    journal = Journal(file, OWNER)
    journal.append(1, b"first")
    order = [("fdatasync", "journal.unfinished"), ("replace", "journal.unfinished"), ("fsync", tmp_path.name)]
    assert [call for call in done if call[0] in {"fdatasync", "replace", "fsync"}] == order
    done.clear()
    journal.append(2, b"second")
    assert done == [("pwrite", "journal"), ("fdatasync", "journal")]


def test_it_has_room_for_the_next_ones_of_the_newest_ones_size(tmp_path: Path) -> None:
    """Else every record of a growing state would be a file of its own."""
    journal = Journal(tmp_path / "journal", OWNER)
    journal.append(1, b"")
    assert journal.has_room(1000)
    assert not journal.has_room(ROOM)
    journal.append(2, bytes(ROOM))
    files = set()
    for n in range(3, 19):
        journal.append(n, bytes(ROOM))
        files.add((tmp_path / "journal").stat().st_ino)
    assert len(files) == 1
    assert [n for n, _ in known(tmp_path / "journal")] == list(range(1, 19))


STEPS = st.lists(st.one_of(st.binary(max_size=200), st.just("restart"), st.floats(0, 1, exclude_max=True)), max_size=40)


@settings(max_examples=60, deadline=None)
@given(steps=STEPS)
def test_it_holds_the_newest_whatever_happens(tmp_path_factory: pytest.TempPathFactory, steps: list[Any]) -> None:
    """Records of any size, restarts, and torn tails: a number says how much of one was written when power failed."""
    file = tmp_path_factory.mktemp("some") / "journal"
    kept = list[tuple[int, bytes]]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "ROOM", 700)
        patch.setattr(module, "RECORDS", 1)
        journal = Journal(file, OWNER)
        for n, step in enumerate(steps, start=1):
            if isinstance(step, bytes):
                journal.append(n, step)
                kept.append((n, step))
                continue
            journal.close()
            if isinstance(step, float) and file.exists():
                tear(file, step, n)
            journal = Journal(file, OWNER)
            journal.go_on_behind(read_journal(file, OWNER).records if file.exists() else [])
            assert (known(file) if file.exists() else [])[-COMPLETE:] == kept[-COMPLETE:]
        found = known(file) if file.exists() else []
        assert found == kept[len(kept) - len(found) :]
        assert len(found) >= min(COMPLETE, len(kept))


def tear(file: Path, share: float, iteration: int) -> None:
    """Write the beginning of one more record."""
    record = Format(OWNER).pack(iteration, b"never said")
    end = HEADER + sum(record.size for record in read_journal(file, OWNER).records)
    with file.open("r+b") as stream:
        stream.seek(end)
        stream.write(record[: int(share * len(record))])
