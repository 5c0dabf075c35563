"""The benchmark's seeds through the ROS network: one process per learner, compared bit for bit with one loop.

Example: .venv/bin/python benches/as_nodes.py ros_ws/config/drones.yaml --first-seed 304 --seeds 3 --json
"""

import json
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml

from mabirds_bringup.bench.outcome import drawn_streams
from mabirds_bringup.console import console, guarded_output
from mabirds_bringup.run.network import Network
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import History, simulate
from mabirds_expert_player.recorder import record
from mabirds_msgs_py.environment import prepare_environment

ROLLOUTS = 2000
"""That judge a policy where its game needs some, as in the benchmark."""


def seeded(source: Path, seed: int, directory: Path) -> Path:
    """A copy of the experiment with demonstrations and rollouts of its own."""
    content = yaml.safe_load(source.read_text(encoding="utf-8"))
    content["seed"] = content["demonstrations"]["seed"] = seed
    content["demonstrations"]["bag"] = f"demonstrations_{seed}"
    file = directory / f"{source.stem}_{seed}.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


def measure(source: Path, seed: int, directory: Path) -> Iterator[dict[str, Any]]:
    """Record, run the processes, and judge what each learner came to."""
    file = seeded(source, seed, directory)
    experiment = load_experiment(file)
    record(experiment, experiment.demonstrations.bag)
    (logs := directory / f"run_{seed}" / "logs").mkdir(parents=True)
    begun = time.monotonic()
    history = Network(experiment, file, logs.parent, {"hz": 1000.0}).run().history
    seconds, game = time.monotonic() - begun, build_game(experiment)
    expected = simulate(experiment, drawn_streams(experiment, game))
    for name, parameters in history.items():
        policy = evaluation_policy(experiment, name, game)(parameters[-1])
        imitation = game.judge.imitation(policy, experiment.seed, ROLLOUTS)
        yield {
            "seed": seed,
            "learner": name,
            "iterations": len(parameters) - 1,
            "violation_rate": imitation.violation_rate,
            "success_rate": imitation.success_rate,
            "equals_one_loop": equal(history, expected, name),
            "seconds_of_the_network": seconds,
        }


def equal(first: History, second: History, name: str) -> bool:
    """Are all parameters of a learner the same to the last bit?"""
    pairs = zip(first[name], second[name], strict=True)
    return all(np.array_equal(a.theta, b.theta) and np.array_equal(a.omega, b.omega) for a, b in pairs)


def main(
    experiment: Annotated[Path, typer.Argument(help="Of any game.")],
    first_seed: Annotated[int, typer.Option(help="As in mabirds bench.", min=0)] = 304,
    seeds: Annotated[int, typer.Option(help="How many.", min=1)] = 3,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,  # noqa: FBT002
) -> None:
    """Run an experiment as ROS processes with several seeds, and judge it as the benchmark does."""
    prepare_environment()
    with guarded_output() as stdout, tempfile.TemporaryDirectory() as directory:
        results = []
        for seed in range(first_seed, first_seed + seeds):
            for result in measure(experiment, seed, Path(directory)):
                console.print(", ".join(f"{name} {value}" for name, value in result.items()))
                results.append(result)
        if as_json:
            print(json.dumps({"results": results}), file=stdout)


if __name__ == "__main__":
    typer.run(main)
