"""Recorded time as it is played: it runs at a rate, and stands still while paused. No ROS."""

from dataclasses import dataclass

ENDLESS = float("inf")


@dataclass
class PlayClock:
    """Seconds of recorded time that have been played, against seconds of a steady clock.

    Parameters
    ----------
    rate : float
        Recorded seconds a second, above 0.
    paused : bool
        Does it stand still?
    played : float
        Recorded seconds up to ``since``.
    since : float
        Seconds of the steady clock.
    """

    rate: float = 1.0
    paused: bool = False
    played: float = 0.0
    since: float = 0.0

    def read(self, now: float) -> float:
        """Recorded seconds played by ``now``."""
        return self.played if self.paused else self.played + (now - self.since) * self.rate

    def set_rate(self, rate: float, now: float) -> None:
        """Run at another rate from ``now`` on; what has been played stays.

        Parameters
        ----------
        rate : float
            Recorded seconds a second, above 0.
        now : float
            Seconds of the steady clock.
        """
        self.played, self.since, self.rate = self.read(now), now, rate

    def set_paused(self, paused: bool, now: float) -> None:  # noqa: FBT001 - its only meaning
        """Stop or go on.

        Parameters
        ----------
        paused : bool
            Stop.
        now : float
            Seconds of the steady clock.
        """
        self.played, self.since, self.paused = self.read(now), now, paused

    def until(self, moment: float, now: float) -> float:
        """How long it is until a moment of recorded time.

        Parameters
        ----------
        moment : float
            Recorded seconds played.
        now : float
            Seconds of the steady clock.

        Returns
        -------
        float
            Seconds of the steady clock; endless while paused.
        """
        return ENDLESS if self.paused else max(0.0, (moment - self.read(now)) / self.rate)
