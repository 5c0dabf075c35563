"""``mabirds bench scale``: how time and memory grow."""

from typing import Annotated, Any

import typer

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import guarded_output, print_json, progress_bar, tell_targets


def scale(
    small: Annotated[bool, typer.Option("--small", help="Small games and four learners: half a minute.")] = False,
    iterations: Annotated[int, typer.Option(help="Of each network.", min=20)] = 600,
    repetitions: Annotated[int, typer.Option(help="Of each size, in turns; intervals need two.", min=1)] = 3,
    as_json: Json = False,
) -> None:
    """Fit how time and memory grow with cells, horizon, experts, and with 2 to 32 learners in a ring.

    Example: mabirds bench scale --small --json
    """
    with guarded_output() as stdout:
        content = measured(iterations, repetitions, small=small)
        tell_targets(content["targets"])
        if as_json:
            print_json(content, stdout)


def measured(iterations: int, repetitions: int, *, small: bool = False) -> dict[str, Any]:
    """Measure each size in processes of its own, all sizes in turns.

    Parameters
    ----------
    iterations : int
        Of each network.
    repetitions : int
        Of each size.
    small : bool, optional
        The small sizes.

    Returns
    -------
    dict[str, Any]
        machine, results, targets.
    """
    # Loads ROS, scipy and polars.
    import multiprocessing
    import os
    from concurrent.futures import ProcessPoolExecutor
    from statistics import median

    from mabirds_bringup.bench.report import machine
    from mabirds_bringup.bench.scale.cases import (
        LEARNERS,
        MOST_OF_LEARNERS,
        SMALL_LEARNERS,
        SMALL_SWEEPS,
        SWEEPS,
    )
    from mabirds_bringup.bench.scale.fit import targets, told
    from mabirds_bringup.bench.scale.measure import network, solved
    from mabirds_bringup.run.processes import ONE_THREAD
    from mabirds_msgs_py.environment import prepare_environment, send_to_this_host

    os.environ.update(ONE_THREAD)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    prepare_environment()
    send_to_this_host()  # as `mabirds run` does
    sweeps, learners = (SMALL_SWEEPS, SMALL_LEARNERS) if small else (SWEEPS, LEARNERS)
    results: dict[str, Any] = {}
    pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), max_tasks_per_child=1)
    with pool, progress_bar() as bar:
        task = bar.add_task("measuring", total=repetitions * (sum(len(of.cases) for of in sweeps) + len(learners)))

        def noted(figures: dict[str, float]) -> dict[str, float]:
            bar.advance(task)
            return figures

        for sweep in sweeps:
            results[sweep.name] = told(
                [
                    {size: noted(pool.submit(solved, case).result()) for size, case in sweep.cases.items()}
                    for _ in range(repetitions)
                ]
            )
        results["learners"] = told(
            [{count: noted(network(count, iterations)) for count in learners} for _ in range(repetitions)], median
        )
    return {
        "machine": machine("numpy", "ros-rclpy"),
        "results": results,
        "targets": targets(results, sweeps, MOST_OF_LEARNERS),
    }
