"""What of ROS's security settings is accepted, and what the files of an enclave must say."""

import doctest
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

import mabirds_msgs_py.security
from mabirds_bringup.security import permissions
from mabirds_bringup.security.keystore import create_keystore
from mabirds_bringup.security.policy import Policy
from mabirds_core.experiment.file import Experiment
from mabirds_msgs_py.security import (
    ENABLE,
    EXPECTED,
    FILES,
    KEYSTORE,
    OVERRIDE,
    STRATEGY,
    SecurityError,
    check_governance,
    check_settings,
    enclave_of,
    is_requested,
)

DAY = timedelta(days=1)


def make_keystore(experiment: Experiment, place: Path) -> Path:
    now = datetime.now(UTC).replace(microsecond=0)
    create_keystore(place, Policy(experiment).processes(), 0, permissions.Validity(now - DAY, now + DAY))
    return place


@pytest.fixture
def secured(experiment: Experiment, tmp_path: Path) -> dict[str, str]:
    """An environment with which learner_1 is secure."""
    keystore = make_keystore(experiment, tmp_path / "keystore")
    return {ENABLE: "true", STRATEGY: "Enforce", KEYSTORE: str(keystore), OVERRIDE: "/learner_1"}


def test_the_examples_hold() -> None:
    results = doctest.testmod(mabirds_msgs_py.security)
    assert (results.failed, results.attempted) == (0, 2)


@pytest.mark.parametrize("environment", [{}, {ENABLE: ""}, {ENABLE: "false"}, {ENABLE: "false", KEYSTORE: "/keys"}])
def test_nobody_asks_for_security(environment: dict[str, str]) -> None:
    assert not is_requested([], environment)


def test_security_is_asked_for() -> None:
    assert is_requested([], {ENABLE: "true"})


@pytest.mark.parametrize("value", ["True", "TRUE", "1", "yes", "on", "true ", "0", "False"])
def test_a_switch_that_ros_would_misunderstand_is_refused(value: str) -> None:
    with pytest.raises(SecurityError, match=f"ROS_SECURITY_ENABLE is '{value}', expected true or false"):
        is_requested([], {ENABLE: value})


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("ros_security_enable", "ROS_SECURITY_ENABLE is meant"),
        ("Ros_Security_Keystore", "ROS_SECURITY_KEYSTORE is meant"),
        ("ROS_SECURITY_ENABLED", "ROS_SECURITY_ENABLE is meant"),
        ("ROS_SECURITY_ROOT_DIRECTORY", "ROS knows ROS_SECURITY_ENABLE"),
        ("ROS_SECURITY_X", "ROS knows ROS_SECURITY_ENABLE"),
    ],
)
def test_an_old_or_misspelt_name_is_refused(secured: dict[str, str], name: str, meant: str) -> None:
    for environment in ({}, secured, {ENABLE: "false"}):
        with pytest.raises(SecurityError, match=f"{name} is set, which .*{meant}"):
            is_requested([], {**environment, name: "x"})


@pytest.mark.parametrize("name", [STRATEGY, KEYSTORE, OVERRIDE])
def test_a_setting_without_the_switch_is_refused(name: str) -> None:
    with pytest.raises(SecurityError, match=f"{name} given without ROS_SECURITY_ENABLE"):
        is_requested([], {name: "x"})


@pytest.mark.parametrize("option", ["-e", "--enclave"])
def test_an_enclave_without_the_switch_is_refused(option: str) -> None:
    with pytest.raises(SecurityError, match=f"{option} given without ROS_SECURITY_ENABLE"):
        is_requested(["--ros-args", option, "/learner_1"], {})


def test_the_last_enclave_counts_and_the_override_most() -> None:
    arguments = ["--ros-args", "--enclave", "/a", "-r", "__ns:=/b", "-e", "/c"]
    assert enclave_of(arguments, {}) == "/c"
    assert enclave_of(arguments, {OVERRIDE: "/d"}) == "/d"


def test_good_settings_are_accepted(secured: dict[str, str]) -> None:
    check_settings([], secured)


@pytest.mark.parametrize("strategy", ["", "Permissive", "enforce", "Enforced"])
def test_every_other_strategy_is_refused(secured: dict[str, str], strategy: str) -> None:
    with pytest.raises(SecurityError, match=f"ROS_SECURITY_STRATEGY is '{strategy}'"):
        check_settings([], {**secured, STRATEGY: strategy})


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_an_enclave_lacks_is_named(secured: dict[str, str], name: str) -> None:
    Path(secured[KEYSTORE], "enclaves", "learner_1", name).unlink()
    with pytest.raises(SecurityError, match=f"learner_1: {name} missing"):
        check_settings([], secured)


def test_an_enclave_that_is_not_there_is_named(secured: dict[str, str]) -> None:
    with pytest.raises(SecurityError, match=r"enclaves/nobody: .* missing; choose an enclave"):
        check_settings(["--enclave", "/nobody"], {**secured, OVERRIDE: ""})


LAX = {
    "allow_unauthenticated_participants": "true",
    "enable_join_access_control": "false",
    "enable_read_access_control": "false",
    "enable_write_access_control": "false",
    "discovery_protection_kind": "NONE",
    "data_protection_kind": "SIGN",
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_lax_governance_is_refused(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    rules = permissions.DOMAIN_RULE if name in permissions.DOMAIN_RULE else permissions.TOPIC_RULE
    monkeypatch.setitem(rules, name, LAX[name])
    keystore = make_keystore(experiment, tmp_path / "keystore")
    with pytest.raises(SecurityError, match=f"{name} is {LAX[name]}, expected"):
        check_governance(keystore / "enclaves" / "governance.p7s")


def test_a_second_lax_rule_is_found(secured: dict[str, str]) -> None:
    file = Path(secured[KEYSTORE], "enclaves", "governance.p7s")
    strict = file.read_bytes()
    start, end = strict.index(b"<topic_rule>"), strict.index(b"</topic_rule>") + len(b"</topic_rule>")
    lax = strict[start:end].replace(b"<data_protection_kind>ENCRYPT", b"<data_protection_kind>NONE")
    file.write_bytes(strict[:end] + lax + strict[end:])
    with pytest.raises(SecurityError, match="data_protection_kind is NONE"):
        check_governance(file)


@pytest.mark.parametrize("content", [b"", b"no XML", b"\xff\x00", b"Content-Type: multipart/signed\n\nnothing"])
def test_what_is_no_governance_file_is_named(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "governance.p7s"
    file.write_bytes(content)
    with pytest.raises(SecurityError, match=r"governance\.p7s: is no signed governance file"):
        check_governance(file)


def test_a_rule_that_is_missing_is_named(tmp_path: Path) -> None:
    file = tmp_path / "governance.p7s"
    file.write_bytes(b"Content-Type: text/plain\n\n<dds/>")
    with pytest.raises(SecurityError, match="allow_unauthenticated_participants is missing"):
        check_governance(file)
