"""What a learner does with its neighbours: W(n)'s part of step 4 of Algorithm 1, whichever way it is carried out.

    (theta, omega)(n + 1) = sum_u W(n)[v, u] (theta_u, omega_u)(n) + local step of learner v

``strict`` is that sum to the letter, over parameters that were all waited for. ``push_sum_mixer`` is the same while
nothing is lost, and loses nothing where messages are lost.
"""

from collections.abc import Callable, Mapping
from typing import Any, Protocol, TypeVar

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array
from mabirds_core.consensus.schedule import EdgeSchedule

LocalStep = Callable[[Parameters], Parameters]
"""From where a learner stands to where its own gradient step leads; raises DivergenceError where that is too far."""


class MixerState(Protocol):
    """What a mixer knows at iteration n. Never changed: a mixer makes a new one."""

    @property
    def parameters(self) -> Parameters:
        """theta(n), omega(n)."""
        ...


State = TypeVar("State", bound=MixerState)
Message = TypeVar("Message")


class Mixer(Protocol[State, Message]):
    """How learner ``name`` mixes with its neighbours of E(n), the edges of ``schedule``.

    An iteration is ``outgoing``, ``incoming`` and ``mix``, each with the same n.
    """

    @property
    def name(self) -> str:
        """Name of the learner whose mixer it is."""
        ...

    @property
    def schedule(self) -> EdgeSchedule:
        """E(n) and W(n)."""
        ...

    def initial(self, parameters: Parameters) -> State:
        """The state at iteration 1, of theta(1) and omega(1)."""
        ...

    def outgoing(self, state: State, iteration: int) -> dict[str, Message]:
        """What is to be sent at iteration n, by the name of the out-neighbour of E(n)."""
        ...

    def incoming(self, state: State, iteration: int, messages: Mapping[str, Message]) -> State:
        """The state with what in-neighbours of E(n) have sent, by their names."""
        ...

    def mix(self, state: State, iteration: int, local_step: LocalStep | None) -> State:
        """The state at n + 1; without ``local_step``, as in a closing round, what is known is mixed and no more."""
        ...

    def to_arrays(self, state: State) -> dict[str, Array]:
        """What a checkpoint must hold besides theta(n) and omega(n)."""
        ...

    def from_arrays(self, parameters: Parameters, arrays: Mapping[str, Array]) -> State:
        """The state again from theta(n), omega(n) and such arrays; raises CheckpointError where they do not fit."""
        ...


AnyMixer = Mixer[Any, Any]
"""The mixer of a learner that does not look into states and messages."""
