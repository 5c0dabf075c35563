"""Declarations of members that only the declared supervisor can make: signed with a key that its learners know.

Without security on the network anybody can publish a declaration. The signature travels as one more member, with a name
that no learner can have.
"""

import hashlib
import hmac
import secrets
from collections.abc import Sequence
from pathlib import Path

from mabirds_core.errors import MabirdsError, RefusedMessageError

MARK = "signature:"

UNSIGNED = "unsigned_declaration"
"""Reason for which a declaration is refused."""

LEAST = 32
"""Characters of a key, at least."""


def make_key(file: Path) -> None:
    """Write a key that nobody else can read; one that is there stays."""
    if not file.exists():
        file.touch(mode=0o600)
        file.write_text(secrets.token_hex(LEAST), encoding="utf-8")


def read_key(file: Path) -> bytes:
    """The key in a file.

    Raises
    ------
    MabirdsError
        There is none.
    """
    try:
        key = file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise MabirdsError(f"{file}: no key of declarations can be read ({error}); name that of the run") from None
    if len(key) < LEAST:
        raise MabirdsError(f"{file}: {len(key)} characters, expected a key of at least {LEAST}; name that of the run")
    return key.encode()


def signed(members: Sequence[str], digest: str, epoch: int, key: bytes) -> list[str]:
    """Sign a declaration.

    Parameters
    ----------
    members : Sequence[str]
        Names.
    digest : str
        Of the run.
    epoch : int
        Of the declaration.
    key : bytes
        Of the run; empty: none.

    Returns
    -------
    list[str]
        The names, and the signature where there is a key.
    """
    return [*members, f"{MARK}{_signature(members, digest, epoch, key)}"] if key else list(members)


def verified(declared: Sequence[str], digest: str, epoch: int, key: bytes) -> list[str]:
    """Check the signature of a declaration.

    Parameters
    ----------
    declared : Sequence[str]
        Names, and a signature perhaps.
    digest : str
        Of the run.
    epoch : int
        Of the declaration.
    key : bytes
        Of the run; empty: whoever declares is believed.

    Returns
    -------
    list[str]
        The names.

    Raises
    ------
    RefusedMessageError
        It is not signed with the key.
    """
    members = [name for name in declared if not name.startswith(MARK)]
    signature = next((name.removeprefix(MARK) for name in declared if name.startswith(MARK)), "")
    if key and not hmac.compare_digest(signature.encode(), _signature(members, digest, epoch, key).encode()):
        raise RefusedMessageError(
            UNSIGNED, "not signed with this run's key; declare by `mabirds members --key RUN/declaration.key`"
        )
    return members


def _signature(members: Sequence[str], digest: str, epoch: int, key: bytes) -> str:
    return hmac.new(key, "\n".join([digest, str(epoch), *members]).encode(), hashlib.sha256).hexdigest()
