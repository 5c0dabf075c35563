"""What a process sets before it uses ROS, and what it leaves to the user."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from mabirds_msgs_py.environment import (
    FASTDDS_CHOICES,
    FASTDDS_PROFILE,
    GENERATOR,
    LOOPBACK_PROFILE,
    ONE_HOST_PROFILE,
    RANGE,
    prepare_environment,
    send_to_this_host,
)

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "mabirds_msgs_py"
SPACE = {"": "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"}
ETHERNET, HEADERS = 1500, 28
"""Bytes: the largest packet of a frame, and the headers of IP and UDP in it."""


def test_an_empty_environment_is_filled_in() -> None:
    environment: dict[str, str] = {}
    prepare_environment(environment)
    assert environment == {
        "AMENT_PREFIX_PATH": sys.prefix,
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(FASTDDS_PROFILE),
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        "HOME": str(Path.cwd()),
    }


def test_processes_of_one_host_keep_to_it_without_shared_memory() -> None:
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    prepare_environment(environment)
    assert environment["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(LOOPBACK_PROFILE)
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"


def test_the_profiles_differ_in_the_addresses_and_in_what_is_sent_only() -> None:
    def settings(file: Path) -> list[str]:
        tree = ET.parse(file)  # noqa: S314 - our own file
        for parent, child in ((".//transport_descriptor", "interfaceWhiteList"), (".//rtps", "propertiesPolicy")):
            inside, apart = tree.find(parent, SPACE), tree.find(f"{parent}/{child}", SPACE)
            if inside is not None and apart is not None:
                inside.remove(apart)
        return ["".join((node.tag, (node.text or "").strip())) for node in tree.iter()]

    assert settings(ONE_HOST_PROFILE) == settings(LOOPBACK_PROFILE) == settings(FASTDDS_PROFILE)
    assert "<address>127.0.0.1</address>" in LOOPBACK_PROFILE.read_text(encoding="utf-8")
    assert "<address>" not in ONE_HOST_PROFILE.read_text(encoding="utf-8")
    assert [sent_at_most(file) for file in (ONE_HOST_PROFILE, LOOPBACK_PROFILE)] == [None, None]


def sent_at_most(profile: Path) -> int | None:
    """Bytes of a datagram."""
    tree = ET.parse(profile)  # noqa: S314 - our own file
    properties = {
        node.findtext("name", "", SPACE): node.findtext("value", "", SPACE)
        for node in tree.iterfind(".//property", SPACE)
    }
    return int(properties["fastdds.max_message_size"]) if properties else None


def test_who_knows_that_all_is_on_this_host_sends_large_datagrams() -> None:
    environment: dict[str, str] = {}
    prepare_environment(environment)
    send_to_this_host(environment)
    assert environment["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(ONE_HOST_PROFILE)
    before = dict(environment)
    prepare_environment(environment)  # as children do
    assert environment == before


@pytest.mark.parametrize("chosen", [{RANGE: "LOCALHOST"}, dict.fromkeys(FASTDDS_CHOICES, "own")])
def test_large_datagrams_change_no_other_choice(chosen: dict[str, str]) -> None:
    environment = dict(chosen)
    prepare_environment(environment)
    before = dict(environment)
    send_to_this_host(environment)
    assert environment == before


@pytest.mark.parametrize("name", FASTDDS_CHOICES)
def test_transports_that_the_user_chose_stay(name: str) -> None:
    environment = {name: "chosen"}
    prepare_environment(environment)
    assert {name: environment[name] for name in FASTDDS_CHOICES if name in environment} == {
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        name: "chosen",
    }


def test_a_child_finds_what_its_parent_set() -> None:
    environment: dict[str, str] = {}
    prepare_environment(environment)
    before = dict(environment)
    prepare_environment(environment)
    assert environment == before


def test_datagrams_of_the_profile_fit_an_ethernet_frame_with_room_for_a_tunnel() -> None:
    transport = ET.parse(FASTDDS_PROFILE).find(".//transport_descriptor", SPACE)  # noqa: S314 - our own file
    assert transport is not None
    assert transport.findtext("type", namespaces=SPACE) == "UDPv4"
    assert (sent_at_most(FASTDDS_PROFILE) or ETHERNET) <= ETHERNET - HEADERS - 60
    assert int(transport.findtext("maxMessageSize", "", SPACE)) > ETHERNET, "what others send must be heard"


def test_fast_dds_takes_the_profile_without_a_word() -> None:
    """It says on standard output what it cannot read, and goes on with its defaults."""
    program = (
        "from mabirds_msgs_py.environment import prepare_environment\n"
        "prepare_environment()\n"
        "import rclpy\n"
        "rclpy.init(); rclpy.create_node('probe').destroy_node(); rclpy.shutdown()"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=30, check=True)
    assert done.stdout + done.stderr == ""


CALLER = {
    "CYCLONEDDS_URI": "file:///of/the/caller.xml",
    "FASTDDS_BUILTIN_TRANSPORTS": "LARGE_DATA",
    "FASTDDS_DEFAULT_PROFILES_FILE": "/of/the/caller.xml",
    "FASTRTPS_DEFAULT_PROFILES_FILE": "/of/the/caller.xml",
    "RMW_IMPLEMENTATION": "rmw_of_the_caller",
    "ROS_DOMAIN_ID": "of the caller",
    "ROS_LOCALHOST_ONLY": "1",
    "ROS_SECURITY_ENABLE": "true",
    "ROS_STATIC_PEERS": "192.0.2.1",
}
"""What somebody who runs the tests may have set for other uses of ROS."""


def test_what_the_caller_chose_does_not_reach_the_tests() -> None:
    name = test_fast_dds_takes_the_profile_without_a_word.__name__
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"{__file__}::{name}"]
    environment = {**os.environ, **CALLER}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_profile_is_installed_with_the_package(tmp_path: Path) -> None:
    command = [sys.executable, "setup.py", "--quiet", "build", "--build-base", str(tmp_path)]
    subprocess.run(command, cwd=PACKAGE, capture_output=True, timeout=60, check=True)
    for profile in (FASTDDS_PROFILE, ONE_HOST_PROFILE, LOOPBACK_PROFILE):
        (installed,) = tmp_path.rglob(profile.name)
        assert installed.parent.name == PACKAGE.name
        assert installed.read_bytes() == profile.read_bytes()


def test_type_support_is_loaded_without_the_generator_which_can_still_be_had() -> None:
    program = f"""
import sys
from mabirds_msgs_py.environment import load_type_support_alone
load_type_support_alone()
load_type_support_alone()
from importlib import import_module
from mabirds_msgs.msg import LearnerStatus
from rclpy.type_support import check_for_type_support
check_for_type_support(LearnerStatus)
print("lark" in sys.modules, "rosidl_generator_py" in sys.modules)
print(import_module({GENERATOR!r}).generate_py.__name__)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split() == ["False", "True", "generate_py"]
