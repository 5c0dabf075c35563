"""``mabirds security``: policies, and keystores that make a middleware enforce them."""

import os
import shlex
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any

import typer

from mabirds_bringup.commands.options import CentralMethodName, ExperimentFile, Json
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_bringup.security.permissions import Validity, publications, subscriptions
from mabirds_bringup.security.policy import Access, Policy, policy_xml
from mabirds_core.experiment.file import load_experiment
from mabirds_core.extras import require
from mabirds_msgs_py.security import SecurityError

HIGHEST_DOMAIN = 232

BACKDATED = timedelta(days=1)
"""Everything holds since a day ago, for hosts whose clocks are behind: Fast DDS takes UTC for the local time."""

Keystore = Annotated[Path, typer.Option(help="Directory of the keystore.")]
Fleet = Annotated[str, typer.Option("--namespace", help="Namespace below which all nodes run, such as /depot.")]

security_app = typer.Typer(help="Who may say and hear what: policies and keystores.")


@security_app.command()
def policy(
    file: ExperimentFile,
    fleet: Fleet = "/",
    method: CentralMethodName = None,
    out: Annotated[Path | None, typer.Option(help="File to write; default: standard output.")] = None,
) -> None:
    """Write an experiment's access-control policy in SROS2's format: one enclave per process.

    Example: mabirds security policy ros_ws/config/patrol.yaml --out policy.xml
    """
    text = policy_xml(Policy(load_experiment(file), fleet, method).processes())
    if out:
        out.write_text(text, encoding="utf-8")
        console.print(f"written to {out}", soft_wrap=True)
    else:
        typer.echo(text, nl=False)


@security_app.command()
def create(
    file: ExperimentFile,
    keystore: Keystore,
    fleet: Fleet = "/",
    method: CentralMethodName = None,
    days: Annotated[int, typer.Option(help="Days for which all certificates hold.", min=1, max=3650)] = 365,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a keystore, with all its keys.")] = False,
    as_json: Json = False,
) -> None:
    """Make a keystore for ROS_DOMAIN_ID: authorities, and keys and signed permissions of each process.

    Example: mabirds security create ros_ws/config/patrol.yaml --keystore keystore
    """
    require("cryptography", "keys and certificates", "mabirds_bringup[security]", SecurityError)
    from mabirds_bringup.security.keystore import create_keystore  # cryptography takes a moment to load

    with guarded_output() as stdout:
        processes, domain = Policy(load_experiment(file), fleet, method).processes(), _domain()
        now = datetime.now(UTC).replace(microsecond=0)
        validity = Validity(now - BACKDATED, now + timedelta(days=days))
        create_keystore(keystore, processes, domain, validity, overwrite=overwrite)
        _tell(keystore, processes, domain, validity)
        if as_json:
            print_json(_content(keystore, processes, domain, validity), stdout)


@security_app.command()
def commands(file: ExperimentFile, keystore: Keystore, fleet: Fleet = "/", method: CentralMethodName = None) -> None:
    """Print the commands that make the same keystore with the SROS2 tools, where they are installed.

    Example: mabirds security commands ros_ws/config/patrol.yaml --keystore keystore
    """
    processes = Policy(load_experiment(file), fleet, method).processes()
    rules = keystore / "policy.xml"
    chosen = ["--namespace", fleet, *(["--method", method] if method else [])]
    lines: list[list[object]] = [
        ["ros2", "security", "create_keystore", keystore],
        ["mabirds", "security", "policy", file, *chosen, "--out", rules],
    ]
    for process in processes:
        lines.append(["ros2", "security", "create_enclave", keystore, process.enclave])
        lines.append(["ros2", "security", "create_permission", keystore, process.enclave, rules])
    typer.echo("\n".join(shlex.join(map(str, line)) for line in lines))


def _domain() -> int:
    """ROS_DOMAIN_ID; raises SecurityError where it is none."""
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not text.isdecimal() or int(text) > HIGHEST_DOMAIN:
        raise SecurityError(f"ROS_DOMAIN_ID is {text!r}: expected a whole number from 0 to {HIGHEST_DOMAIN}")
    return int(text)


def _tell(keystore: Path, processes: tuple[Access, ...], domain: int, validity: Validity) -> None:
    console.print(
        f"{keystore}: {len(processes)} enclaves for ROS domain {domain}, valid until {validity.end:%Y-%m-%d};"
        f" take {keystore / 'private'} away from machines that run nodes",
        soft_wrap=True,
    )


def _content(keystore: Path, processes: tuple[Access, ...], domain: int, validity: Validity) -> dict[str, Any]:
    enclaves = {
        process.enclave: {
            "namespace": process.namespace,
            "node": process.node,
            "publish": publications(process),
            "subscribe": subscriptions(process),
        }
        for process in processes
    }
    return {
        "keystore": str(keystore.absolute()),
        "domain": domain,
        "valid_from": validity.begin.isoformat(),
        "valid_until": validity.end.isoformat(),
        "enclaves": enclaves,
    }
