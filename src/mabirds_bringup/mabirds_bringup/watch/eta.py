"""How long it will still take."""

import math


def eta_text(seconds: float | None) -> str:
    """A duration in few letters; nothing where it is not known.

    >>> eta_text(9.4), eta_text(75.0), eta_text(7300.0), eta_text(None)
    ('9s', '1m15', '2h02', '')
    """
    if seconds is None or not math.isfinite(seconds):
        return ""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole}s"
    minutes, rest = divmod(whole, 60)
    return f"{minutes}m{rest:02}" if minutes < 60 else f"{minutes // 60}h{minutes % 60:02}"


def remaining(done: int, total: int, rate: float | None) -> float | None:
    """Seconds until ``total`` at so many per second; None where nothing moves."""
    if done >= total:
        return 0.0
    return (total - done) / rate if rate else None
