"""The constrained soft Bellman policy of any number of drones by soft actor-critic, at the temperature tau.

    y     = e(s, a) + gamma ( r(s', 0) + min_k Q'_k(t+1, s', a') - tau log pi_{t+1}(a'|s') ),   a' ~ pi_{t+1}
    Q_k  <- Q_k - lr grad mean ( ( Q_k(t, s, a) - y ) / h_t )^2                                 k = 1, 2: twin critics
    pi   <- pi  - lr grad mean ( tau log pi_t(a|s) - min_k Q_k(t, s, a) ),                                    a ~ pi_t
    Q'_k <- Q'_k + rho (Q_k - Q'_k)                                                                    target networks

with r = r_theta + omega^T phi, e(s, a) = r(s, a) - r(s, 0), and y = e(s, a) where t = T (Haarnoja, Zhou, Abbeel and
Levine, ICML 2018; twin critics: Fujimoto, van Hoof and Meger, ICML 2018). tau stays as it is given: the fixed point is
the soft Bellman policy of the reward divided by tau.

- log pi is relative to mu, uniform in the disc of actions. The actor is a mixture of Gaussians (``mixtures``), and the
  expectation over its modes is taken, not drawn: log w has a gradient without noise.
- Where exact planners know the values, networks have nothing to learn: there ``guided_actor`` takes their place.
- The game has an end: networks are told t, and h_t = 1 + gamma h_{t+1}, h_{T+1} = 0, is what a reward of one in every
  step left is worth. The network is q_k = Q_k / h_t, a mean reward of a step still to come: of one order at every t.
- The dynamics are known, so critics are shown the successor s' of (s, a), through which the actor's gradient passes.
  Rewards are known as well, so Q leaves out r(s, 0), which no action changes: its rest follows from a and s'.
- Transitions are replayed off policy, those of step t as often as gamma^t says: V_0 less the soft return of pi from P_0
  is E_pi sum_t gamma^t KL(pi_t | exp Q_t / tau), the gap (``SacPolicy.gap``).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeGuard

import numpy as np
import torch
from torch import Tensor

from mabirds_core.arrays import Array, Vector
from mabirds_core.errors import ExperimentError
from mabirds_core.games.drones.actor_critic_memory import recalled, remembered
from mabirds_core.games.drones.actor_critic_networks import MODES, Adam, Networks
from mabirds_core.games.drones.actor_critic_policy import ActorCritic, Problem, SacPolicy, torch_threads
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

FIRST_ROLLOUTS = 4
"""The first search begins with so many times more rollouts, of random actions."""

HOLD = 8
"""For so many steps random actions are held."""

MOST_GRADIENT = 20.0
"""The actor's gradient is cut to this length [nats]."""


class Minibatch(NamedTuple):
    """Transitions of one gradient step, shapes (batch, ...), and what the actor draws from."""

    states: Tensor
    actions: Tensor
    successors: Tensor
    efforts: Tensor
    """r(s, a) - r(s, 0)."""
    idle: Tensor
    """r(s', 0); of the last steps of rollouts neither this nor s' counts."""
    times: Tensor
    noise: Tensor
    """Standard normal, for s' and for s, shape (batch, 2, K, 2 N_E)."""
    uniform: Tensor
    """In [0, 1), shape (batch,)."""


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
        rewards = ((self.reward_model, theta), (self.game.cost_features, omega))
        problem = Problem(self.game, rewards, self.temperature)
        replay = start.replay.with_rollouts(self._flights(start, rng), self.capacity)
        replay = replay.with_demonstrations(observed, self.capacity)
        with torch_threads(self.threads):
            learned = self._trained(start, problem, replay, rng)
        return SacPolicy(start.networks, learned, replay, start.searches + 1, problem)

    def _flights(self, start: SacPolicy, rng: np.random.Generator) -> Trajectories:
        """New ones for the replay: of the policy before, at first many random ones to see the arena."""
        if start.searches:
            return drone_rollouts(self.game, start, self.rollouts, rng)
        return self._random_rollouts(FIRST_ROLLOUTS * self.rollouts, rng)

    def _fits(self, previous: Policy | None) -> TypeGuard[SacPolicy]:
        if not isinstance(previous, SacPolicy):
            return False
        return previous.networks.game.digest == self.game.digest and previous.networks.hidden == self.hidden

    def _beginning(self, rng: np.random.Generator) -> SacPolicy:
        networks = Networks(self.game, self.hidden)
        actor, critics = networks.initial_actor(rng), networks.critic.initial(2, rng)
        return SacPolicy(networks, ActorCritic(Adam.of(actor), Adam.of(critics), critics), Replay.empty(self.game), 0)

    def _random_rollouts(self, count: int, rng: np.random.Generator) -> Trajectories:
        """Rollouts by actions from mu that are held for a while, so that they come around in the arena."""
        game, length = self.game, self.game.horizon + 1
        shape = (count, length // HOLD + 1, game.n_experts)
        radius, angle = np.sqrt(rng.random(shape)), rng.uniform(0, 2 * np.pi, size=shape)
        held = game.dynamics.max_action * np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
        actions = np.repeat(held.reshape(count, -1, game.action_size), HOLD, axis=1)[:, :length]
        states = np.empty((count, length, game.state_size))
        states[:, 0] = game.starts(count, rng)
        for step in range(game.horizon):
            states[:, step + 1] = game.step(states[:, step], actions[:, step])
        return Trajectories(states, actions)

    def _trained(self, start: SacPolicy, problem: Problem, replay: Replay, rng: np.random.Generator) -> ActorCritic:
        """After the search's gradient steps."""
        rate = self.learning_rate / np.sqrt(1 + start.searches / PATIENCE)
        networks = Networks(self.game, self.hidden, self.device)
        learned = start.learned.on(self.device)
        steps = self.steps if start.searches else self.first_steps
        for batch in self._batches(problem, replay, steps, rng):
            learned = self._step(networks, problem, learned, batch, rate)
        return learned.on("cpu")

    def _batches(self, problem: Problem, replay: Replay, steps: int, rng: np.random.Generator) -> Iterator[Minibatch]:
        """Transitions drawn from the replay, with the rewards of the problem."""
        states, actions = replay.transitions
        idle, rewards = (problem.reward(states, chosen) for chosen in (np.zeros_like(actions), actions))
        times = np.arange(len(states)) % (self.game.horizon + 1)
        drawn = torch.from_numpy(replay.draws(steps, self.batch, SHOWN, self.game.discount, rng)).to(self.device)
        noise = rng.standard_normal((steps, self.batch, 2, MODES, self.game.action_size), dtype=np.float32)
        uniform = rng.random((steps, self.batch), dtype=np.float32)
        columns = (states, actions, np.roll(states, -1, axis=0), rewards - idle, np.roll(idle, -1), times)
        rows = [torch.tensor(values, dtype=torch.float32, device=self.device)[drawn] for values in columns]
        return map(Minibatch, *rows, *(torch.tensor(values, device=self.device) for values in (noise, uniform)))

    def _step(
        self, networks: Networks, problem: Problem, learned: ActorCritic, batch: Minibatch, rate: float
    ) -> ActorCritic:
        """One step of the critics, then one of the actor, then the targets follow."""
        actor, critics, targets = learned
        wanted = self._wanted(networks, problem, learned, batch)
        error = partial(self._critic_loss, networks, batch=batch, wanted=wanted)
        critics = critics.descend(gradient(error, critics.weights), rate)
        loss = partial(self._actor_loss, networks, problem, critics=critics.weights, batch=batch)
        slope = gradient(loss, actor.weights)
        slope *= (MOST_GRADIENT * self.temperature / slope.norm()).clamp(max=1.0)
        return ActorCritic(actor.descend(slope, rate), critics, targets.lerp(critics.weights, SMOOTHING))

    @torch.no_grad()
    def _wanted(self, networks: Networks, problem: Problem, learned: ActorCritic, batch: Minibatch) -> Tensor:
        """What the critics are to say of ``batch``: y per step left, shape (batch,)."""
        later = batch.times + 1
        mixture = networks.mixture(learned.actor.weights, batch.successors, later)
        chosen, log_pi = mixture.act(mixture.chosen(mixture.draw(batch.noise[:, 0]), batch.uniform))
        actions = networks.dynamics.max_action * chosen[:, 0]
        q = problem.q(networks, learned.targets, batch.successors, later, actions)
        value = torch.where(later <= self.game.horizon, batch.idle + q - self.temperature * log_pi[:, 0], 0.0)
        return (batch.efforts + self.game.discount * value) / networks.horizons[batch.times.long()]

    def _critic_loss(self, networks: Networks, critics: Tensor, batch: Minibatch, wanted: Tensor) -> Tensor:
        successors = networks.after(batch.states, batch.actions)
        return ((networks.q(critics, batch.states, batch.times, batch.actions, successors) - wanted) ** 2).mean()

    def _actor_loss(
        self, networks: Networks, problem: Problem, actor: Tensor, critics: Tensor, batch: Minibatch
    ) -> Tensor:
        """Of every mode by its weight: the gradient in weights has no noise of a choice."""
        mixture = networks.mixture(actor, batch.states, batch.times)
        actions, log_pi = mixture.act(mixture.draw(batch.noise[:, 1]))
        states, times = (values.repeat_interleave(MODES, dim=0) for values in (batch.states, batch.times))
        q = problem.q(networks, critics, states, times, networks.dynamics.max_action * actions.flatten(0, 1))
        return (mixture.log_weights.exp() * (self.temperature * log_pi - q.view(log_pi.shape))).sum(1).mean()

    def state_dict(self, policy: Policy) -> dict[str, Array]:
        """Networks with Adam's moments, the replay and the counts."""
        return remembered(policy)

    def load_state_dict(self, memory: Mapping[str, Array]) -> SacPolicy:
        """The policy that was remembered."""
        return recalled(self.game, self.hidden, memory)


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
