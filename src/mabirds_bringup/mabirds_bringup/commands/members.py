"""``mabirds members``: declare who takes part in a network in resilient mode."""

from pathlib import Path
from typing import Annotated

import rclpy
import typer
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_bringup.run.declaration import MembershipPublisher
from mabirds_bringup.run.network import KEY
from mabirds_msgs_py.declaration_key import read_key
from mabirds_msgs_py.security import enclave_arguments, start_ros

OF_THE_LATEST = Path("runs", "latest", KEY)


def members(
    names: Annotated[list[str], typer.Argument(help="Learners that take part from now on.")],
    namespace: Annotated[str, typer.Option(help="Where the learners' namespaces are, such as /depot.")] = "/",
    timeout: Annotated[float, typer.Option(help="Seconds to find them, and for them to follow.", min=0.1)] = 20.0,
    key: Annotated[
        Path | None, typer.Option(help="Key of the run: RUN/declaration.key (that of runs/latest, if there).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Declare the members of a running network: whom it is to go on without, or who joins it.

    Example: mabirds members learner_1 learner_2 learner_4
    """
    enclave = enclave_arguments(f"{namespace.rstrip('/')}/declarer")
    start_ros(["--ros-args", *enclave], signal_handler_options=SignalHandlerOptions.NO)
    try:
        with guarded_output() as stdout:
            file = key or (OF_THE_LATEST if OF_THE_LATEST.exists() else None)
            secret = read_key(file) if file else b""
            node, executor = MembershipPublisher(names, key=secret, namespace=namespace), SingleThreadedExecutor()
            executor.add_node(node)
            epoch = node.declare(executor, timeout)
            console.print(f"epoch {epoch}: {', '.join(names)}", soft_wrap=True)
            if as_json:
                print_json({"epoch": epoch, "members": names}, stdout)
    finally:
        rclpy.try_shutdown()
