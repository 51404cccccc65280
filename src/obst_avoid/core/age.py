"""How old a value is. The one place that compares stamps."""

from typing import Optional

from obst_avoid.core.types import Stamped, T

NANOSECONDS = 1_000_000_000


def age(stamp: int, now: int) -> float:
    """Seconds from stamp to now, both ROS time in ns. Negative: the stamp lies in the future."""
    return (now - stamp) / NANOSECONDS


def why_stale(name: str, value: Optional[Stamped[T]], now: int, limit: float, ahead: float) -> Optional[str]:
    """Say why a value must not be used, or None when it is fresh.

    name: how a person calls the value. now: [ns]. limit: [s] oldest allowed age.
    ahead: [s] how far in the future a stamp may lie; clocks of /clock tick, and publishers are not in step.
    """
    if value is None:
        return 'no %s yet' % name
    seconds = age(value.stamp, now)
    if seconds > limit:
        return 'the %s is %.2f s old, limit %.2f s' % (name, seconds, limit)
    if seconds < -ahead:
        return 'the %s is stamped %.2f s in the future, limit %.2f s' % (name, -seconds, ahead)
    return None


def fresh(value: Optional[Stamped[T]], now: int, limit: float, ahead: float) -> Optional[Stamped[T]]:
    """The value where why_stale has nothing to say, else None."""
    return value if why_stale('', value, now, limit, ahead) is None else None


def why_stopped(stood: float, limit: float) -> Optional[str]:
    """Say why the clock must not be trusted, or None. stood: [s] of wall time since ROS time moved. limit: [s]."""
    if stood > limit:
        return 'the clock has stood still for %.1f s, limit %.1f s' % (stood, limit)
    return None
