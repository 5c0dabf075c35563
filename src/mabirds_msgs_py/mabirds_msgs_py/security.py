"""Security that was asked for is proven before a node starts; otherwise the node does not start.

ROS itself is lenient: where a variable is missing or misspelt it goes on without security and says nothing, and so may
a middleware that was built without it. So the settings are checked here, and then the middleware is asked for what no
permissions allow: only one that enforces them refuses.
"""

import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterEvent
from rclpy._rclpy_pybind11 import RCLError
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.utilities import get_rmw_implementation_identifier

from mabirds_core.errors import MabirdsError
from mabirds_msgs_py.process_settings import ProcessSettingsError, check_process_settings

ENABLE = "ROS_SECURITY_ENABLE"
STRATEGY = "ROS_SECURITY_STRATEGY"
KEYSTORE = "ROS_SECURITY_KEYSTORE"
OVERRIDE = "ROS_SECURITY_ENCLAVE_OVERRIDE"
PREFIX = "ROS_SECURITY_"
OPTIONS = ("--enclave", "-e")

FILES = (
    "identity_ca.cert.pem",
    "cert.pem",
    "key.pem",
    "permissions_ca.cert.pem",
    "governance.p7s",
    "permissions.p7s",
)
"""What a middleware reads from the directory of an enclave."""

EXPECTED = {
    "allow_unauthenticated_participants": ("false", "0"),
    "enable_join_access_control": ("true", "1"),
    "enable_read_access_control": ("true", "1"),
    "enable_write_access_control": ("true", "1"),
    "discovery_protection_kind": ("ENCRYPT", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION"),
    "data_protection_kind": ("ENCRYPT",),
}
"""What every rule of a governance file must say; with others, security can be on and protect nothing."""

FORBIDDEN = "/mabirds_security_probe"
"""A topic of no policy."""

ALLOWED = "/parameter_events"
"""A topic of every policy."""


class SecurityError(MabirdsError):
    """Security cannot be had as it was asked for."""


def start_ros(arguments: Sequence[str], **options: Any) -> None:
    """Start ROS, and prove that security is enforced where it was asked for.

    Parameters
    ----------
    arguments : Sequence[str]
        Of the command line.
    **options : Any
        Of ``rclpy.init``.

    Raises
    ------
    SecurityError
        It is not; ROS is shut down then.
    ProcessSettingsError
        ROS cannot be started with these arguments in this environment.
    """
    check_process_settings(arguments)
    secured = is_requested(arguments)
    if secured:
        check_settings(arguments)
    try:
        rclpy.init(args=list(arguments), **options)
    except RuntimeError as error:  # of several kinds
        raise ProcessSettingsError(f"ROS does not start: {' '.join(str(error).split())}; see --help") from None
    try:
        if secured:
            prove_enforcement()
    except SecurityError:
        rclpy.try_shutdown()
        raise


def enclave_arguments(enclave: str, environment: Mapping[str, str] = os.environ) -> list[str]:
    """ROS arguments that put a process into its enclave.

    Parameters
    ----------
    enclave : str
        Its name.
    environment : Mapping[str, str], optional
        Of the process.

    Returns
    -------
    list[str]
        None where security is off.

    Raises
    ------
    SecurityError
        As of ``is_requested``.

    Examples
    --------
    >>> enclave_arguments("/learner_1", {"ROS_SECURITY_ENABLE": "true"}), enclave_arguments("/learner_1", {})
    (['--enclave', '/learner_1'], [])
    """
    return [OPTIONS[0], enclave] if is_requested([], environment) else []


def is_requested(arguments: Sequence[str], environment: Mapping[str, str] = os.environ) -> bool:
    """Is security asked for?

    Asking is: any of ROS's security variables, or an enclave among the arguments. ROS_SECURITY_ENABLE=false
    takes it back.

    Parameters
    ----------
    arguments : Sequence[str]
        Of the command line.
    environment : Mapping[str, str], optional
        Of the process.

    Returns
    -------
    bool
        Whether it is.

    Raises
    ------
    SecurityError
        It seems so, but ROS would go on without.
    """
    require_known_names(environment)
    enable = environment.get(ENABLE, "")
    if enable in {"true", "false"}:
        return enable == "true"
    if enable:
        raise SecurityError(
            f"{ENABLE} is {enable!r}, expected true or false: ROS would take it for false and say nothing"
        )
    signs = [name for name in (STRATEGY, KEYSTORE, OVERRIDE) if environment.get(name)]
    signs += [option for option in OPTIONS if option in arguments]
    if signs:
        raise SecurityError(
            f"{', '.join(signs)} given without {ENABLE}: ROS would start without security and say nothing; set"
            f" {ENABLE}=true, or {ENABLE}=false to do without"
        )
    return False


def require_known_names(environment: Mapping[str, str]) -> None:
    """Check that no variable means security under a name that ROS does not read, old or misspelt.

    Raises
    ------
    SecurityError
        One does.
    """
    known = (ENABLE, STRATEGY, KEYSTORE, OVERRIDE)
    for name in environment:
        if name.upper().startswith(PREFIX) and name not in known:
            import difflib  # for the message alone

            tails = [option.removeprefix(PREFIX) for option in known]
            nearest = difflib.get_close_matches(name.upper().removeprefix(PREFIX), tails, n=1)
            hint = f"; {PREFIX}{nearest[0]} is meant, or unset it" if nearest else f"; ROS knows {', '.join(known)}"
            raise SecurityError(f"{name} is set, which ROS does not read: it would start without security{hint}")


def check_settings(arguments: Sequence[str], environment: Mapping[str, str] = os.environ) -> None:
    """Check that ROS will insist on security, with a complete enclave and a strict governance.

    Parameters
    ----------
    arguments : Sequence[str]
        Of the command line.
    environment : Mapping[str, str], optional
        Of the process.

    Raises
    ------
    SecurityError
        It will not.
    """
    strategy, keystore = environment.get(STRATEGY, ""), environment.get(KEYSTORE, "")
    if strategy != "Enforce":
        raise SecurityError(
            f"{STRATEGY} is {strategy!r}: ROS would start without security where a file is missing, and say nothing;"
            f" set {STRATEGY}=Enforce"
        )
    if not keystore:
        raise SecurityError(f"{KEYSTORE} is not set; make a keystore with `mabirds security create` and give its path")
    directory = Path(keystore, "enclaves", enclave_of(arguments, environment).lstrip("/"))
    missing = [name for name in FILES if not (directory / name).is_file()]
    if missing:
        raise SecurityError(
            f"{directory}: {', '.join(missing)} missing; choose an enclave of {keystore} by --ros-args --enclave /NAME"
        )
    check_governance(directory / "governance.p7s")


def enclave_of(arguments: Sequence[str], environment: Mapping[str, str] = os.environ) -> str:
    """The enclave that ROS will choose.

    Parameters
    ----------
    arguments : Sequence[str]
        Of the command line.
    environment : Mapping[str, str], optional
        Of the process.

    Returns
    -------
    str
        Its name.

    Examples
    --------
    >>> enclave_of(["--ros-args", "--enclave", "/learner_1"], {}), enclave_of([], {})
    ('/learner_1', '/')
    """
    given = [value for option, value in pairwise(arguments) if option in OPTIONS]
    return environment.get(OVERRIDE) or (given[-1] if given else "/")


def check_governance(file: Path) -> None:
    """Check that no rule lets somebody in, or leaves something open, that must not be.

    The signature is the middleware's to check, and it does so when it reads the same file.

    Raises
    ------
    SecurityError
        A rule does, or the file is no governance file.
    """
    import email  # where security is on alone
    from xml.etree import ElementTree as ET

    message = email.message_from_bytes(file.read_bytes())
    document = next((part for part in message.walk() if part.get_content_type() == "text/plain"), message)
    try:
        root = ET.fromstring(bytes(document.get_payload(decode=True) or b""))  # noqa: S314 - as trusted as the keystore
    except ET.ParseError as error:
        raise SecurityError(f"{file}: is no signed governance file ({error}); make the keystore anew") from None
    for name, allowed in EXPECTED.items():
        values = [(element.text or "").strip() for element in root.iter(name)] or ["missing"]
        if wrong := [value for value in values if value not in allowed]:
            raise SecurityError(f"{file}: {name} is {wrong[0]}, expected {allowed[0]}; make the keystore anew")


def prove_enforcement(context: Context | None = None) -> None:
    """Check that the middleware refuses what no permissions allow.

    A node is made that publishes what every node publishes, and then one publisher more of the same type. If that one
    is refused, and one for what every node publishes is not, the middleware has read permissions and enforces them: it
    fails for no other reason.

    Parameters
    ----------
    context : Context, optional
        Default: the global one.

    Raises
    ------
    SecurityError
        It is not refused, everything is, or the middleware cannot start with security.
    """
    middleware = get_rmw_implementation_identifier()
    try:
        probe = make_probe(context)
    except RCLError as error:
        reason = " ".join(str(error).split())
        raise SecurityError(
            f"{middleware} cannot start with security: {reason}; take a ROS installation whose middleware has it, and a"
            " keystore that was made for this ROS_DOMAIN_ID and is still valid"
        ) from None
    try:
        probe.create_publisher(ParameterEvent, FORBIDDEN, 1)
    except RCLError:
        _require_allowed(probe, middleware)
        return
    finally:
        probe.destroy_node()
    raise SecurityError(
        f"security is on, but {middleware} let this process publish {FORBIDDEN}, which no policy allows: it enforces"
        " nothing, or the permissions of this enclave allow everything; take a ROS installation whose middleware has"
        " security, and an enclave made by `mabirds security create`"
    )


def _require_allowed(probe: Node, middleware: str) -> None:
    """Raise SecurityError where what every policy allows is refused as well: then it was no refusal."""
    try:
        probe.create_publisher(ParameterEvent, ALLOWED, 1)
    except RCLError as error:
        reason = " ".join(str(error).split())
        raise SecurityError(
            f"{middleware} makes no publisher at all ({reason}), so that nothing is known of its permissions; see what"
            " this process lacks"
        ) from None


def make_probe(context: Context | None) -> Node:
    """A node with nothing but the publisher that no rclpy node goes without."""
    return Node(
        "security_probe",
        context=context,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("start_type_description_service", value=False)],
    )
