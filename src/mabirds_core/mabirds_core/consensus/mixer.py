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
        """What is to be sent at iteration n.

        Parameters
        ----------
        state : State
            The state at iteration n.
        iteration : int
            n.

        Returns
        -------
        dict[str, Message]
            By the name of the out-neighbour of E(n).
        """
        ...

    def incoming(self, state: State, iteration: int, messages: Mapping[str, Message]) -> State:
        """Take what in-neighbours have sent.

        Parameters
        ----------
        state : State
            The state at iteration n.
        iteration : int
            n.
        messages : Mapping[str, Message]
            By the name of the in-neighbour of E(n).

        Returns
        -------
        State
            The state at n that knows them.
        """
        ...

    def mix(self, state: State, iteration: int, local_step: LocalStep | None) -> State:
        """Go on to iteration n + 1.

        Parameters
        ----------
        state : State
            The state at iteration n with what was received.
        iteration : int
            n.
        local_step : LocalStep or None
            Learner v's own step. None, as in a closing round: what is known is mixed and no more.

        Returns
        -------
        State
            The state at n + 1.
        """
        ...

    def to_arrays(self, state: State) -> dict[str, Array]:
        """What a checkpoint must hold besides theta(n) and omega(n)."""
        ...

    def from_arrays(self, parameters: Parameters, arrays: Mapping[str, Array]) -> State:
        """Inverse of ``to_arrays``.

        Parameters
        ----------
        parameters : Parameters
            theta(n), omega(n).
        arrays : Mapping[str, Array]
            By name, as ``to_arrays`` gave them.

        Returns
        -------
        State
            The state again.

        Raises
        ------
        CheckpointError
            The arrays do not fit the parameters.
        """
        ...


AnyMixer = Mixer[Any, Any]
"""The mixer of a learner that does not look into states and messages."""
