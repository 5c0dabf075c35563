"""What ROS reads from the environment, looked at first: it would end without a word, hang, or say it in C++."""

import os
import resource
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from mabirds_core.errors import MabirdsError
from mabirds_core.texts import truncate
from mabirds_msgs_py.environment import RANGE

DOMAIN = "ROS_DOMAIN_ID"

MAX_DOMAIN = 232
"""Higher ones have no port numbers."""

RANGES = ("SUBNET", "LOCALHOST", "SYSTEM_DEFAULT")
"""Where others are looked for. OFF is none: nobody would be heard, and a node would wait for ever."""

LEAST_MEMORY = 900_000
"""KiB of addresses that a node takes, nearly all of them never used: 880,360 as measured."""


class ProcessSettingsError(MabirdsError):
    """A process cannot use ROS with these settings."""


def check_process_settings(arguments: Sequence[str], environment: Mapping[str, str] = os.environ) -> None:
    """Check what would end or hang a process that starts ROS.

    Parameters
    ----------
    arguments : Sequence[str]
        Of the command line.
    environment : Mapping[str, str], optional
        Of the process.

    Raises
    ------
    ProcessSettingsError
        One of the settings would.
    """
    for check in CHECKS:
        check(environment)
    for argument in arguments:
        if argument.startswith(("-e=", "--enclave=")):
            option, _, value = argument.partition("=")
            raise ProcessSettingsError(f"{argument}: ROS takes {option} and its value apart; write {option} {value}")
    _check_rules(arguments)


def _check_rules(arguments: Sequence[str]) -> None:
    """Raise ProcessSettingsError for a rule of names that nothing announces."""
    for before, argument in zip(["", *arguments], arguments, strict=False):
        if argument.startswith(("__ns:=", "__node:=", "__name:=")) and before not in {"-r", "--remap"}:
            raise ProcessSettingsError(f"{argument}: ROS takes it after -r only; write --ros-args -r {argument}")


def _check_domain(environment: Mapping[str, str]) -> None:
    domain = environment.get(DOMAIN) or "0"
    if not (domain.isascii() and domain.isdecimal() and int(domain) <= MAX_DOMAIN):
        raise ProcessSettingsError(f"{DOMAIN} is {truncate(domain)!r}, expected a number from 0 to {MAX_DOMAIN}")


def _check_range(environment: Mapping[str, str]) -> None:
    given = environment.get(RANGE, "")
    if given and given not in RANGES:
        why = "nobody would hear this process, nor it them" if given == "OFF" else "ROS would keep to this host"
        raise ProcessSettingsError(
            f"{RANGE} is {truncate(given)!r}: {why}; set it to one of {', '.join(RANGES)}, or not at all"
        )


def _check_log_directory(environment: Mapping[str, str]) -> None:
    home = environment.get("ROS_HOME") or Path(environment.get("HOME", "."), ".ros")
    directory = Path(environment.get("ROS_LOG_DIR") or Path(home, "log"))
    try:
        directory.mkdir(parents=True, exist_ok=True)
        writable = os.access(directory, os.W_OK | os.X_OK)
    except OSError:
        writable = False
    if not writable:
        raise ProcessSettingsError(
            f"{directory}: ROS cannot write its logs here; set HOME, or ROS_LOG_DIR, to a place that can be written"
        )


def _check_memory(environment: Mapping[str, str]) -> None:  # noqa: ARG001 - of the process, not of its environment
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY * 1024:
        raise ProcessSettingsError(
            f"the limit of this process's addresses (ulimit -v) is {limit // 1024} KiB, a node takes {LEAST_MEMORY};"
            " raise it, or limit resident memory by a control group"
        )


CHECKS: tuple[Callable[[Mapping[str, str]], None], ...] = (
    _check_domain,
    _check_range,
    _check_log_directory,
    _check_memory,
)
