"""Keystores, by independent readers: what is in them, who may read it, and who signed it."""

import json
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from mabirds_bringup.security.keystore import create_keystore
from mabirds_bringup.security.permissions import Validity
from mabirds_bringup.security.policy import Policy, policy_xml
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_msgs_py.security import FILES, SecurityError

MABIRDS = str(Path(sys.executable).with_name("mabirds"))
OPENSSL = shutil.which("openssl")
needs_openssl = pytest.mark.skipif(OPENSSL is None, reason="openssl, the independent reader, is not installed")

OTHERS = ("expert_player", "monitor", "inspector", "dashboard", "drawing", "picture", "player_client")
"""Enclaves beside those of learners."""

BEGIN = datetime(2026, 1, 1, tzinfo=UTC)
VALIDITY = Validity(BEGIN, BEGIN + timedelta(days=30))

MakeExperiment = Callable[..., Path]


@pytest.fixture
def trio(make_experiment: MakeExperiment) -> Experiment:
    return load_experiment(make_experiment(learners=3))


@pytest.fixture
def keystore(trio: Experiment, tmp_path: Path) -> Path:
    """A keystore for three learners that is valid now."""
    now = datetime.now(UTC).replace(microsecond=0)
    place = tmp_path / "keystore"
    create_keystore(place, Policy(trio).processes(), 5, Validity(now, now + timedelta(days=1)))
    return place


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def key(path: Path) -> ec.EllipticCurvePrivateKey:
    loaded = load_pem_private_key(path.read_bytes(), None)
    assert isinstance(loaded, ec.EllipticCurvePrivateKey)
    return loaded


def test_the_layout_is_that_of_the_sros2_tools(keystore: Path) -> None:
    files = {str(path.relative_to(keystore)) for path in keystore.rglob("*") if path.is_file()}
    enclaves = ("learner_1", "learner_2", "learner_3", *OTHERS)
    assert files == {
        *(f"public/{name}_ca.cert.pem" for name in ("identity", "permissions")),
        *(f"private/{name}_ca.key.pem" for name in ("identity", "permissions")),
        *(f"enclaves/governance.{suffix}" for suffix in ("xml", "p7s")),
        *(f"enclaves/{name}/{file}" for name in enclaves for file in (*FILES, "permissions.xml")),
    }


def test_private_keys_are_for_their_owner_alone(keystore: Path) -> None:
    keys = list(keystore.rglob("*.key.pem")) + list(keystore.rglob("key.pem"))
    assert len(keys) == 2 + 3 + len(OTHERS)
    assert {stat.S_IMODE(file.stat().st_mode) for file in keys} == {0o600}
    assert stat.S_IMODE((keystore / "private").stat().st_mode) == 0o700


def test_an_enclave_can_be_copied_alone(keystore: Path, tmp_path: Path) -> None:
    """With its links followed, it is all that a host needs; and no link leads out of the keystore."""
    links = [path for path in keystore.rglob("*") if path.is_symlink()]
    assert all(not path.readlink().is_absolute() for path in links)
    assert all(path.resolve().is_relative_to(keystore) for path in links)
    copy = shutil.copytree(keystore / "enclaves" / "learner_1", tmp_path / "copy")
    assert {path.name for path in copy.iterdir() if path.is_file()} == {*FILES, "permissions.xml"}


@pytest.mark.parametrize("enclave", ["learner_1", "expert_player", "inspector"])
def test_a_certificate_names_its_enclave_and_leads_to_the_identity_authority(keystore: Path, enclave: str) -> None:
    folder = keystore / "enclaves" / enclave
    own, authority = certificate(folder / "cert.pem"), certificate(folder / "identity_ca.cert.pem")
    own.verify_directly_issued_by(authority)
    assert own.subject.rfc4514_string() == f"CN=/{enclave}"
    assert key(folder / "key.pem").public_key() == own.public_key()
    public = own.public_key()
    assert isinstance(public, ec.EllipticCurvePublicKey)
    assert public.curve.name == "secp256r1"
    assert not own.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    usage = own.extensions.get_extension_for_class(x509.KeyUsage)
    assert usage.critical
    assert usage.value.digital_signature
    assert not usage.value.key_cert_sign
    assert own.not_valid_before_utc <= datetime.now(UTC) <= own.not_valid_after_utc


def test_every_process_has_a_key_of_its_own(keystore: Path) -> None:
    files = [*keystore.rglob("key.pem"), *keystore.rglob("*.key.pem")]
    numbers = {key(file).private_numbers().private_value for file in files}
    assert len(numbers) == len(files)


def test_who_vouches_for_identities_cannot_vouch_for_permissions(keystore: Path) -> None:
    """Else a process could sign permissions for itself, see mabirds_bringup.security.keystore."""
    permissions_authority = certificate(keystore / "public" / "permissions_ca.cert.pem")
    for file in keystore.rglob("cert.pem"):
        with pytest.raises((ValueError, InvalidSignature)):
            certificate(file).verify_directly_issued_by(permissions_authority)


@needs_openssl
def test_openssl_follows_the_chain(keystore: Path) -> None:
    command = ["verify", "-x509_strict", "-CAfile", keystore / "public" / "identity_ca.cert.pem"]
    assert openssl(*command, keystore / "enclaves" / "learner_1" / "cert.pem").returncode == 0
    assert openssl(*command, keystore / "public" / "permissions_ca.cert.pem").returncode != 0


def openssl(*arguments: object) -> "subprocess.CompletedProcess[bytes]":
    return subprocess.run([str(OPENSSL), *map(str, arguments)], capture_output=True, timeout=20, check=False)


def verified(file: Path, authority: Path) -> "subprocess.CompletedProcess[bytes]":
    return openssl("smime", "-verify", "-text", "-in", file, "-CAfile", authority)


@needs_openssl
def test_openssl_verifies_the_signatures_and_finds_the_documents(keystore: Path) -> None:
    authority = keystore / "public" / "permissions_ca.cert.pem"
    signed = list(keystore.rglob("*.p7s"))
    assert len(signed) == 1 + 2 * (3 + len(OTHERS))
    for file in signed:
        plain = file.resolve().with_suffix(".xml").read_bytes()
        done = verified(file, authority)
        assert done.returncode == 0, done.stderr
        assert done.stdout.replace(b"\r\n", b"\n") == plain


@needs_openssl
def test_openssl_refuses_a_changed_document_and_another_signer(keystore: Path) -> None:
    file, public = keystore / "enclaves" / "learner_1" / "permissions.p7s", keystore / "public"
    assert verified(file, public / "identity_ca.cert.pem").returncode != 0
    file.write_bytes(file.read_bytes().replace(b"rt/learner_2/parameters", b"rt/learner_3/parameters"))
    assert verified(file, public / "permissions_ca.cert.pem").returncode != 0


def test_a_keystore_is_not_overwritten_unless_asked(keystore: Path, trio: Experiment) -> None:
    before = (keystore / "private" / "identity_ca.key.pem").read_bytes()
    processes = Policy(trio).processes()
    with pytest.raises(SecurityError, match="is a keystore already; choose another place, or give --overwrite"):
        create_keystore(keystore, processes, 0, VALIDITY)
    assert (keystore / "private" / "identity_ca.key.pem").read_bytes() == before
    create_keystore(keystore, processes, 0, VALIDITY, overwrite=True)
    assert (keystore / "private" / "identity_ca.key.pem").read_bytes() != before
    assert [path.name for path in keystore.parent.iterdir() if "keystore" in path.name] == ["keystore"]


def test_what_is_no_keystore_is_never_overwritten(tmp_path: Path, trio: Experiment) -> None:
    (tmp_path / "thesis.tex").write_text("years of work", encoding="utf-8")
    with pytest.raises(SecurityError, match="is there already and is no keystore"):
        create_keystore(tmp_path, Policy(trio).processes(), 0, VALIDITY, overwrite=True)
    assert (tmp_path / "thesis.tex").read_text(encoding="utf-8") == "years of work"


def test_a_keystore_appears_whole_or_not_at_all(
    tmp_path: Path, trio: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("mabirds_bringup.security.keystore._link", fail)
    with pytest.raises(OSError, match="No space left"):
        create_keystore(tmp_path / "new" / "keystore", Policy(trio).processes(), 0, VALIDITY)
    assert list((tmp_path / "new").iterdir()) == []


def test_a_name_too_long_for_a_certificate_is_refused(tmp_path: Path, trio: Experiment) -> None:
    with pytest.raises(SecurityError, match="expected at most 64 characters"):
        create_keystore(tmp_path / "keystore", Policy(trio, f"/{'x' * 60}").processes(), 0, VALIDITY)


def security(*arguments: object, domain: str = "7") -> "subprocess.CompletedProcess[str]":
    environment = {"PATH": "/usr/bin:/bin", "ROS_DOMAIN_ID": domain}
    command = [MABIRDS, "security", *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)


def test_create_says_what_it_made(make_experiment: MakeExperiment, tmp_path: Path) -> None:
    place = tmp_path / "keystore"
    done = security("create", make_experiment(), "--keystore", place, "--days", 30, "--json")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert (content["keystore"], content["domain"]) == (str(place), 7)
    assert set(content["enclaves"]) == {
        "/learner_1",
        "/learner_2",
        *(f"/{name}" for name in OTHERS),
    }
    assert "rt/learner_1/demonstration" in content["enclaves"]["/learner_1"]["subscribe"]
    own = certificate(place / "enclaves" / "learner_1" / "cert.pem")
    assert own.not_valid_after_utc.isoformat() == content["valid_until"]
    assert timedelta(days=29) < own.not_valid_after_utc - datetime.now(UTC) <= timedelta(days=30)
    # Fast DDS takes the dates of permissions, which are in UTC, for the local time.
    assert datetime.now(UTC) - own.not_valid_before_utc > timedelta(hours=12)
    assert "9 enclaves for ROS domain 7" in " ".join(done.stderr.split())
    again = security("create", tmp_path / "experiment" / "experiment.yaml", "--keystore", place)
    assert again.returncode == 2
    assert "give --overwrite" in " ".join(again.stderr.split())


@pytest.mark.parametrize("domain", ["233", "-1", "one"])
def test_create_refuses_a_domain_that_is_none(make_experiment: MakeExperiment, tmp_path: Path, domain: str) -> None:
    done = security("create", make_experiment(), "--keystore", tmp_path / "keystore", domain=domain)
    assert done.returncode == 2
    assert f"ROS_DOMAIN_ID is '{domain}': expected a whole number from 0 to 232" in " ".join(done.stderr.split())
    assert not (tmp_path / "keystore").exists()


def test_policy_writes_the_same_to_a_file_and_to_the_terminal(make_experiment: MakeExperiment, tmp_path: Path) -> None:
    file = make_experiment()
    shown = security("policy", file, "--namespace", "/depot")
    assert shown.returncode == 0, shown.stderr
    assert security("policy", file, "--namespace", "/depot", "--out", tmp_path / "policy.xml").returncode == 0
    assert (tmp_path / "policy.xml").read_text(encoding="utf-8") == shown.stdout
    assert shown.stdout == policy_xml(Policy(load_experiment(file), "/depot").processes())


def test_commands_are_those_of_sros2(make_experiment: MakeExperiment) -> None:
    done = security("commands", make_experiment(), "--keystore", "my keys", "--method", "bics")
    lines = done.stdout.splitlines()
    assert lines[0] == "ros2 security create_keystore 'my keys'"
    assert lines[1].startswith("mabirds security policy ")
    assert lines[1].endswith("--namespace / --method bics --out 'my keys/policy.xml'")
    assert lines[2:4] == [
        "ros2 security create_enclave 'my keys' /bics",
        "ros2 security create_permission 'my keys' /bics 'my keys/policy.xml'",
    ]
    assert len(lines) == 2 + 2 * (1 + len(OTHERS))
