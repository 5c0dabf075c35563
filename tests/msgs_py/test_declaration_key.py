"""Declarations of members: signed with the key of a run, or refused."""

from pathlib import Path

import pytest

from mabirds_core.errors import MabirdsError, RefusedMessageError
from mabirds_msgs_py.declaration_key import make_key, read_key
from mabirds_msgs_py.mass_conversion import membership_message, read_membership

KEY, OTHER = b"k" * 32, b"o" * 32
MEMBERS = ["learner_1", "learner_2"]


@pytest.mark.parametrize("key", [KEY, b""])
def test_what_is_signed_is_believed(key: bytes) -> None:
    assert read_membership(membership_message("run", 2, MEMBERS, KEY), "run", key) == MEMBERS
    assert read_membership(membership_message("run", 2, MEMBERS), "run") == MEMBERS


def test_what_is_not_is_refused() -> None:
    forged = membership_message("run", 2, MEMBERS, OTHER)
    unsigned = membership_message("run", 2, MEMBERS)
    later = membership_message("run", 2, MEMBERS, KEY)
    later.epoch = 3
    others = membership_message("run", 2, MEMBERS, KEY)
    others.members = [others.members[0], others.members[2]]
    odd = membership_message("run", 2, [*MEMBERS, "signature:ü"])
    for message in (forged, unsigned, later, others, odd):
        with pytest.raises(RefusedMessageError, match="not signed with this run's key") as refused:
            read_membership(message, "run", KEY)
        assert refused.value.reason == "unsigned_declaration"


def test_a_key_is_made_once_for_nobody_else(tmp_path: Path) -> None:
    make_key(tmp_path / "key")
    first = read_key(tmp_path / "key")
    make_key(tmp_path / "key")
    assert read_key(tmp_path / "key") == first
    assert len(first) == 64
    assert (tmp_path / "key").stat().st_mode & 0o777 == 0o600


def test_what_is_no_key_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MabirdsError, match="no key of declarations can be read"):
        read_key(tmp_path / "nowhere")
    (tmp_path / "short").write_text("x", encoding="utf-8")
    with pytest.raises(MabirdsError, match="1 characters, expected a key of at least 32"):
        read_key(tmp_path / "short")
