"""From the discounted feature counts of one demonstration back to its steps, in a tabular game."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.interface import TabularGame, Visitation

TOLERANCE = 1e-4
"""Of a discounted count; the last step of a demonstration weighs more."""

MAX_NODES = 100_000
"""Steps that are tried for one demonstration."""


@dataclass
class _Search:
    """Where a search is: counts that are left, joint states until now, and the actions between them."""

    remaining: Vector
    states: list[int]
    actions: list[int]


@dataclass(frozen=True)
class Decoder:
    """Finds the trajectory whose counts are given, step by step, taking back what leads nowhere.

    Cost features must be counts. Actions that lead to the same state by the same features are one.
    """

    game: TabularGame
    _known: dict[int, Array] = field(default_factory=dict)

    @cached_property
    def _weights(self) -> Vector:
        """gamma^t, shape (T + 1,)."""
        return np.asarray(self.game.discount ** np.arange(self.game.horizon + 1))

    def _active(self, state: int) -> Array:
        """Features at each action, shape (A, K)."""
        if state not in self._known:
            actions = range(self.game.n_actions)
            self._known[state] = np.array([self._features(state, action) for action in actions])
        return self._known[state]

    def _features(self, state: int, action: int) -> Vector:
        here = Visitation(np.array([state]), np.array([action]), np.ones(1))
        return self.game.cost_features.total(here)

    def steps(self, counts: Vector, start: int) -> Indices | None:
        """The joint states t = 0..T whose counts are ``counts``; None where no way from ``start`` has them."""
        search = _Search(counts.copy(), [start], [])
        choices = [self._choices(search.remaining, start, 0)]
        for _ in range(MAX_NODES):
            if not choices:
                return None
            if not choices[-1]:
                choices.pop()
                self._take_back(search)
                continue
            self._go(search, choices[-1].pop())
            if len(search.actions) <= self.game.horizon:
                choices.append(self._choices(search.remaining, search.states[-1], len(search.actions)))
            elif np.abs(search.remaining).max() < TOLERANCE:
                return np.array(search.states[:-1])
            else:
                self._take_back(search)
        return None

    def _go(self, search: "_Search", action: int) -> None:
        state = search.states[-1]
        search.remaining -= self._weights[len(search.actions)] * self._active(state)[action]
        search.actions.append(action)
        search.states.append(int(self.game.successor[state, action]))

    def _take_back(self, search: "_Search") -> None:
        """Undo the last action, if there was one."""
        if search.actions:
            action = search.actions.pop()
            search.states.pop()
            search.remaining += self._weights[len(search.actions)] * self._active(search.states[-1])[action]

    def _choices(self, remaining: Vector, state: int, t: int) -> list[int]:
        """Actions for which enough is left, the best last: that leaves as little as can be of what it uses."""
        used = self._weights[t] * self._active(state)
        left = remaining - used
        possible = np.flatnonzero((left > -TOLERANCE).all(axis=1))
        after = self.game.successor[state]
        different = {(int(after[action]), used[action].tobytes()): int(action) for action in possible}
        return sorted(different.values(), key=lambda action: -float(left[action][used[action] > 0].sum()))
