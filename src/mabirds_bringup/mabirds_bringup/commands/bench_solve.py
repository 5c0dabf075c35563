"""``mabirds bench solve``: times of policies and expectations."""

from typing import Annotated, Any

import typer

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import guarded_output, print_json, tell_targets


def solve(
    small: Annotated[bool, typer.Option("--small", help="One small game, and ratios alone: seconds.")] = False,
    as_json: Json = False,
) -> None:
    """Time policies with their expectations, against limits of the machine, the readable reference and a peer.

    The peer is the package `imitation`, where it is installed. Example: mabirds bench solve --small --json
    """
    with guarded_output() as stdout:
        content = measured(small)
        tell_targets(content["targets"])
        if as_json:
            print_json(content, stdout)


def measured(small: bool) -> dict[str, Any]:
    """Measure each case in a process of its own, one after the other.

    Parameters
    ----------
    small : bool
        Ratios alone.

    Returns
    -------
    dict[str, Any]
        machine, results, targets.
    """
    # Loads scipy and polars.
    import multiprocessing
    import os
    from concurrent.futures import ProcessPoolExecutor

    from mabirds_bringup.bench.report import machine
    from mabirds_bringup.bench.solve.cases import CASES, ITERATIONS, SMALL
    from mabirds_bringup.bench.solve.measure import iteration, measure
    from mabirds_bringup.bench.solve.targets import targets
    from mabirds_bringup.run.processes import ONE_THREAD
    from mabirds_core.arithmetic import arithmetic

    os.environ.update(ONE_THREAD)
    cases, experiments = (SMALL, ()) if small else (CASES, tuple(ITERATIONS))
    pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), max_tasks_per_child=1)
    with pool:
        results = {case.name: pool.submit(measure, case).result() for case in cases}
        results |= {f"iteration of {name}": pool.submit(iteration, name).result() for name in experiments}
    versions = machine("numpy", "imitation") | {"arithmetic": arithmetic()}
    return {"machine": versions, "results": results, "targets": targets(cases, results)}
