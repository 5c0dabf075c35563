"""The constrained soft Bellman policy of any number of drones by soft actor-critic, at the temperature tau.

    y     = e(s, a) + gamma ( r(s', 0) + min_k Q'_k(t+1, s', a') - tau log pi_{t+1}(a'|s') ),   a' ~ pi_{t+1}
    Q_k  <- Q_k - lr grad mean ( ( Q_k(t, s, a) - y ) / h_t )^2                                 k = 1, 2: twin critics
    pi   <- pi  - lr grad mean ( tau log pi_t(a|s) - min_k Q_k(t, s, a) ),                                    a ~ pi_t
    Q'_k <- Q'_k + rho (Q_k - Q'_k)                                                                    target networks

with r = r_theta + omega^T phi, e(s, a) = r(s, a) - r(s, 0), and y = e(s, a) where t = T (Haarnoja, Zhou, Abbeel and
Levine, ICML 2018; twin critics: Fujimoto, van Hoof and Meger, ICML 2018). tau stays as it is given: the fixed point is
the soft Bellman policy of the reward divided by tau.

- log pi is relative to mu, uniform in the disc of actions, so that values are those of ``lattice``. Each drone's
  action is a = a_max (tanh |u| / |u|) u with u Gaussian, its mean and deviation from the actor network.
- The game has an end: networks are told t, and Q_k(t, s, a) = h_t q_k(t, s, a, s'), where h_t = 1 + gamma h_{t+1},
  h_{T+1} = 0, is what a reward of one in every step left is worth. The network q_k, the mean reward of a step still
  to come, is of the same order at every t.
- The dynamics are known, so critics are shown the successor s' of (s, a), through which the actor's gradient passes.
  Rewards are known as well, so Q leaves out r(s, 0), which no action changes: its rest follows from a and s'.
- Transitions are replayed off policy: rollouts of all searches, and demonstrations, which lead where rewards are.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple, TypeGuard

import numpy as np
import torch
from torch import Tensor

from mabirds_core.arrays import Array, Vector
from mabirds_core.errors import CheckpointError, ExperimentError
from mabirds_core.games.drones.actor_critic_networks import Adam, Networks, squashed
from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.replay import Replay
from mabirds_core.games.drones.rewards import DroneRewardModel
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.interface import Trajectories
from mabirds_core.planners.interface import Policy

SMOOTHING = 0.02
"""rho."""

SHOWN = 0.25
"""Share of a batch that is drawn from demonstrations, where there are any."""

PATIENCE = 20.0
"""After k searches the learning rate is learning_rate / sqrt(1 + k / PATIENCE)."""

RANDOM_ROLLOUTS, HOLD = 4, 8
"""The first search begins with so many times more rollouts, of random actions that are held for so many steps."""

MOMENTS = ("weights", "mean", "square")
"""The tensors of ``Adam``."""

MAX_NUMBER = float(np.finfo(np.float32).max)
"""No remembered number may be larger."""


class Minibatch(NamedTuple):
    """Transitions of one gradient step, shapes (batch, ...), and standard normal noise (batch, 2, 2 N_E)."""

    states: Tensor
    actions: Tensor
    successors: Tensor
    efforts: Tensor
    """r(s, a) - r(s, 0)."""
    idle: Tensor
    """r(s', 0); of the last steps of rollouts neither this nor s' counts."""
    times: Tensor
    noise: Tensor


class ActorCritic(NamedTuple):
    """What a gradient step changes."""

    actor: Adam
    critics: Adam
    targets: Tensor

    def on(self, device: str) -> "ActorCritic":
        """The same networks on ``device``."""
        return ActorCritic(self.actor.on(device), self.critics.on(device), self.targets.to(device))


@dataclass(frozen=True)
class SacPolicy:
    """The policy, and what the next search starts from."""

    networks: Networks
    learned: ActorCritic
    replay: Replay
    searches: int
    """How many led to this policy."""

    def act(self, step: int, states: Array, rng: np.random.Generator) -> Array:
        """An action for each of M joint states (M, N_E D), shape (M, 2 N_E)."""
        now = torch.tensor(states, dtype=torch.float32), torch.full((len(states),), float(step))
        with torch_threads(1), torch.no_grad():
            mean, log_deviation = (x.double() for x in self.networks.gaussian(self.learned.actor.weights, *now))
            u = mean + log_deviation.exp() * torch.from_numpy(rng.standard_normal(mean.shape))
            actions, _ = squashed(u.view(len(states), -1, 2))
        return np.asarray(self.networks.game.dynamics.max_action * actions.flatten(1).numpy())


@dataclass(frozen=True)
class SacPlanner:
    """The planner that learns from its own rollouts and from those observed; it starts where ``previous`` stopped.

    Raises
    ------
    ExperimentError
        The device is missing.
    """

    game: DroneGame
    reward_model: DroneRewardModel
    temperature: float
    """tau: the policy is the soft Bellman policy of the reward divided by tau. Rewards should be of order 1."""
    hidden: int = 128
    """Units of each of the two hidden layers of every network."""
    steps: int = 150
    """Gradient steps per search."""
    first_steps: int = 600
    """Gradient steps of a search that starts from nothing."""
    batch: int = 128
    """Transitions per gradient step."""
    capacity: int = 30_000
    """Transitions of rollouts that are kept, and as many of demonstrations."""
    rollouts: int = 32
    """Trajectories that a search draws from the policy it starts from."""
    learning_rate: float = 1e-3
    """Learning rate of the first search; see PATIENCE."""
    device: str = "cpu"
    """"cpu" or "cuda"."""
    threads: int = 1
    """Threads of torch on the CPU; with one, results repeat bit for bit."""

    def __post_init__(self) -> None:
        if self.device == "cuda" and not torch.cuda.is_available():
            raise ExperimentError("device cuda: torch finds no GPU that it can use; set device to cpu")

    def plan(
        self,
        theta: Vector,
        omega: Vector,
        previous: Policy | None = None,
        rng: np.random.Generator | None = None,
        observed: Trajectories | None = None,
    ) -> SacPolicy:
        """An estimate of pi(omega, theta), decided by the arguments alone; ``previous`` stays as it is.

        It begins anew where ``previous`` is None, of another kind or of another game.
        """
        if rng is None:
            raise TypeError("a soft actor-critic draws rollouts, but rng is None; pass a numpy.random.Generator")
        start = previous if self._fits(previous) else self._beginning(rng)
        new = drone_rollouts(self.game, start, self.rollouts, rng) if start.searches else self._random_rollouts(rng)
        replay = start.replay.with_rollouts(new, self.capacity).with_demonstrations(observed, self.capacity)
        with torch_threads(self.threads):
            learned = self._trained(start, theta, omega, replay, rng)
        return SacPolicy(start.networks, learned, replay, start.searches + 1)

    def _fits(self, previous: Policy | None) -> TypeGuard[SacPolicy]:
        if not isinstance(previous, SacPolicy):
            return False
        return previous.networks.game.digest == self.game.digest and previous.networks.hidden == self.hidden

    def _beginning(self, rng: np.random.Generator) -> SacPolicy:
        networks = Networks(self.game, self.hidden)
        actor, critics = networks.actor.initial(1, rng), networks.critic.initial(2, rng)
        return SacPolicy(networks, ActorCritic(Adam.of(actor), Adam.of(critics), critics), Replay.empty(self.game), 0)

    def _random_rollouts(self, rng: np.random.Generator) -> Trajectories:
        """Rollouts by actions from mu that are held for a while, so that they come around in the arena."""
        game, count, length = self.game, RANDOM_ROLLOUTS * self.rollouts, self.game.horizon + 1
        shape = (count, length // HOLD + 1, game.n_experts)
        radius, angle = np.sqrt(rng.random(shape)), rng.uniform(0, 2 * np.pi, size=shape)
        held = game.dynamics.max_action * np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
        actions = np.repeat(held.reshape(count, -1, game.action_size), HOLD, axis=1)[:, :length]
        states = np.empty((count, length, game.state_size))
        states[:, 0] = game.starts(count, rng)
        for step in range(game.horizon):
            states[:, step + 1] = game.step(states[:, step], actions[:, step])
        return Trajectories(states, actions)

    def _trained(
        self, start: SacPolicy, theta: Vector, omega: Vector, replay: Replay, rng: np.random.Generator
    ) -> ActorCritic:
        """After the search's gradient steps."""
        rate = self.learning_rate / np.sqrt(1 + start.searches / PATIENCE)
        networks = Networks(self.game, self.hidden, self.device)
        learned = start.learned.on(self.device)
        for batch in self._batches(theta, omega, replay, self.steps if start.searches else self.first_steps, rng):
            learned = self._step(networks, learned, batch, rate)
        return learned.on("cpu")

    def _batches(
        self, theta: Vector, omega: Vector, replay: Replay, steps: int, rng: np.random.Generator
    ) -> Iterator[Minibatch]:
        """Transitions drawn from the replay, with the rewards of theta and omega."""
        states, actions = replay.transitions
        idle, rewards = (self._rewards(theta, omega, states, chosen) for chosen in (np.zeros_like(actions), actions))
        times = np.arange(len(states)) % (self.game.horizon + 1)
        drawn = torch.from_numpy(replay.draws(steps, self.batch, SHOWN, rng)).to(self.device)
        noise = rng.standard_normal((steps, self.batch, 2, self.game.action_size), dtype=np.float32)
        columns = (states, actions, np.roll(states, -1, axis=0), rewards - idle, np.roll(idle, -1), times)
        rows = [torch.tensor(values, dtype=torch.float32, device=self.device)[drawn] for values in columns]
        return map(Minibatch, *rows, torch.tensor(noise, device=self.device))

    def _rewards(self, theta: Vector, omega: Vector, states: Array, actions: Array) -> Vector:
        """r(s, a), shape (M,)."""
        rewards = total_reward(self.game.space, self.reward_model, theta, states, actions)
        return rewards + total_reward(self.game.space, self.game.cost_features, omega, states, actions)

    def _step(self, networks: Networks, learned: ActorCritic, batch: Minibatch, rate: float) -> ActorCritic:
        """One step of the critics, then one of the actor, then the targets follow."""
        actor, critics, targets = learned
        wanted = self._wanted(networks, learned, batch)
        critics = critics.descend(
            gradient(lambda weights: self._critic_loss(networks, weights, batch, wanted), critics.weights), rate
        )
        actor = actor.descend(
            gradient(lambda weights: self._actor_loss(networks, weights, critics.weights, batch), actor.weights), rate
        )
        return ActorCritic(actor, critics, targets.lerp(critics.weights, SMOOTHING))

    @torch.no_grad()
    def _wanted(self, networks: Networks, learned: ActorCritic, batch: Minibatch) -> Tensor:
        """y, what the critics are to say of ``batch``, shape (batch,)."""
        later = batch.times + 1
        actions, log_pi = networks.draw(learned.actor.weights, batch.successors, later, batch.noise[:, 0])
        q = networks.q(learned.targets, batch.successors, later, actions).amin(0)
        value = batch.idle + networks.horizons[later.long()] * q - self.temperature * log_pi
        return batch.efforts + self.game.discount * torch.where(later <= self.game.horizon, value, 0.0)

    def _critic_loss(self, networks: Networks, critics: Tensor, batch: Minibatch, wanted: Tensor) -> Tensor:
        q = networks.q(critics, batch.states, batch.times, batch.actions)
        return ((q - wanted / networks.horizons[batch.times.long()]) ** 2).mean()

    def _actor_loss(self, networks: Networks, actor: Tensor, critics: Tensor, batch: Minibatch) -> Tensor:
        actions, log_pi = networks.draw(actor, batch.states, batch.times, batch.noise[:, 1])
        q = networks.q(critics, batch.states, batch.times, actions).amin(0)
        return (self.temperature * log_pi - networks.horizons[batch.times.long()] * q).mean()

    def state_dict(self, policy: Policy) -> dict[str, Array]:
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

    def load_state_dict(self, memory: Mapping[str, Array]) -> SacPolicy:
        """The policy that was remembered."""
        networks = Networks(self.game, self.hidden)
        searches, *counts = _numbers(memory, "counts", (3,)).tolist()
        if not all(count >= 0 and count == int(count) for count in (searches, *counts)):
            raise CheckpointError(f"counts: {memory['counts'].tolist()}, expected whole numbers from 0")
        shapes = {"actor": (1, networks.actor.size), "critics": (2, networks.critic.size)}
        actor, critics = (
            Adam(**{part: _tensor(memory, f"{name}.{part}", shape) for part in MOMENTS}, steps=int(count))
            for (name, shape), count in zip(shapes.items(), counts, strict=True)
        )
        targets = _tensor(memory, "targets", shapes["critics"])
        replay = Replay(_flights(self.game, memory, "rollouts"), _flights(self.game, memory, "demonstrations"))
        return SacPolicy(networks, ActorCritic(actor, critics, targets), replay, int(searches))


def gradient(loss: Callable[[Tensor], Tensor], weights: Tensor) -> Tensor:
    """grad loss.

    Parameters
    ----------
    loss : Callable[[Tensor], Tensor]
        A number for weights.
    weights : Tensor
        Where the gradient is taken.

    Returns
    -------
    Tensor
        Shape of ``weights``.
    """
    at = weights.detach().requires_grad_()
    return torch.autograd.grad(loss(at), at)[0]


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """So many threads inside, and what it was after."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


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
