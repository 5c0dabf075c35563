"""What a checkpoint holds of a soft actor-critic."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError
from mabirds_core.games.drones.actor_critic_networks import Adam, Networks
from mabirds_core.games.drones.actor_critic_policy import ActorCritic, SacPolicy
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.replay import Replay
from mabirds_core.games.interface import Trajectories

MOMENTS = ("weights", "mean", "square")
"""The tensors of ``Adam``."""

MAX_NUMBER = float(np.finfo(np.float32).max)
"""No remembered number may be larger."""


def remembered(policy: SacPolicy) -> dict[str, Array]:
    """Networks with Adam's moments, the replay and the counts."""
    actor, critics, targets = policy.learned
    tensors = {"targets": targets}
    for name, weights in (("actor", actor), ("critics", critics)):
        tensors |= {f"{name}.{part}": getattr(weights, part) for part in MOMENTS}
    return {
        "counts": np.array([policy.searches, actor.steps, critics.steps], dtype=np.float64),
        **{name: tensor.double().numpy() for name, tensor in tensors.items()},
        **{f"rollouts.{name}": values for name, values in policy.replay.rollouts._asdict().items()},
        **{f"demonstrations.{name}": values for name, values in policy.replay.demonstrations._asdict().items()},
    }


def recalled(game: DroneGame, hidden: int, memory: Mapping[str, Array]) -> SacPolicy:
    """The policy that was remembered.

    Parameters
    ----------
    game : DroneGame
        Of the drones.
    hidden : int
        Units of each hidden layer.
    memory : Mapping[str, Array]
        What ``remembered`` gave.

    Returns
    -------
    SacPolicy
        Without the problem that it was found for.

    Raises
    ------
    CheckpointError
        The memory does not fit.
    """
    networks = Networks(game, hidden)
    searches, *counts = _numbers(memory, "counts", (3,)).tolist()
    if not all(count >= 0 and count == int(count) for count in (searches, *counts)):
        raise CheckpointError(f"counts: {memory['counts'].tolist()}, expected whole numbers from 0")
    shapes = {"actor": (1, networks.actor.size), "critics": (2, networks.critic.size)}
    actor, critics = (
        Adam(**{part: _tensor(memory, f"{name}.{part}", shape) for part in MOMENTS}, steps=int(count))
        for (name, shape), count in zip(shapes.items(), counts, strict=True)
    )
    targets = _tensor(memory, "targets", shapes["critics"])
    replay = Replay(_flights(game, memory, "rollouts"), _flights(game, memory, "demonstrations"))
    return SacPolicy(networks, ActorCritic(actor, critics, targets), replay, int(searches))


def _numbers(memory: Mapping[str, Array], name: str, shape: tuple[int, ...]) -> Array:
    """What is remembered under ``name``, of ``shape``; a length of -1 is any."""
    values = memory.get(name, np.empty(0))
    fits = len(values.shape) == len(shape) and all(m in {-1, n} for n, m in zip(values.shape, shape, strict=True))
    if not fits or not (np.abs(values) <= MAX_NUMBER).all():
        raise CheckpointError(
            f"{name}: shape {values.shape}, expected {shape} and finite numbers; the checkpoint is of another game or"
            " other settings of the planner"
        )
    return values


def _tensor(memory: Mapping[str, Array], name: str, shape: tuple[int, ...]) -> Tensor:
    return torch.tensor(_numbers(memory, name, shape), dtype=torch.float32)


def _flights(game: DroneGame, memory: Mapping[str, Array], name: str) -> Trajectories:
    length = game.horizon + 1
    states = _numbers(memory, f"{name}.states", (-1, length, game.state_size))
    actions = _numbers(memory, f"{name}.actions", (len(states), length, game.action_size))
    return Trajectories(states, actions)
