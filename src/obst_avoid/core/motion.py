"""How far the robot has come by what it was told, and where the road's points have gone meanwhile.

Commands say what the wheels shall do, not what they did: what is computed here is as good as the robot obeys.
"""

import math
from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

from obst_avoid.core.age import age
from obst_avoid.core.types import Command, Stamped

HISTORY = 2.0
"""[s] of commands that a caller of the detector keeps: pictures farther apart than that are no sequence."""
LONGEST_HOLD = 0.5
"""[s] for which a command counts: a controller gives at least 10 a second; of one that has fallen silent nobody knows
what the wheels do.
"""


@dataclass(frozen=True)
class Motion:
    """Where the robot is, seen from where it was. x, y: [m] in the robot frame of then. turn: [rad], left positive."""

    x: float = 0.0
    y: float = 0.0
    turn: float = 0.0


def remembered(
    commands: Sequence[Stamped[Command]], newest: Stamped[Command], seconds: float = HISTORY
) -> Tuple[Stamped[Command], ...]:
    """The commands so far and a new one, without those more than so many seconds older. Time that ran backwards
    begins anew.
    """
    if commands and newest.stamp < commands[-1].stamp:
        return (newest,)
    return tuple(old for old in commands if age(old.stamp, newest.stamp) <= seconds) + (newest,)


def motion_between(
    commands: Sequence[Stamped[Command]], since: int, until: int, longest: float = LONGEST_HOLD
) -> Optional[Motion]:
    """How the robot moved from since to until, both [ns].

    commands: oldest first. Each counts until the next one, the first one also for the time before it.
    longest: [s] for which a command counts at most, forwards and, the first one, backwards.
    Returns None when it is not known: no commands, or none for longer than that; and when until lies before since.
    """
    if until < since:
        return None
    if not commands or age(since, commands[0].stamp) > longest:
        return None
    whole, now = Motion(), since
    first = len(commands) - 1
    while first > 0 and commands[first].stamp > since:  # from the end: mostly, the last moments are asked for
        first -= 1
    for index in range(first, len(commands)):
        item, last = commands[index], index + 1 == len(commands)
        end = until if last else min(commands[index + 1].stamp, until)
        if end <= now and not last:
            continue
        if age(item.stamp, end) > longest:
            return None
        whole, now = then(whole, arc(item.value, age(now, end))), end
        if now == until:
            break
    return whole


def arc(command: Command, seconds: float) -> Motion:
    """The path of a robot that does as it is told."""
    turn = command.omega * seconds
    length = chord(command.v, command.omega, seconds)
    return Motion(length * math.cos(turn / 2), length * math.sin(turn / 2), turn)


def chord(v: float, omega: float, seconds: float) -> float:
    """[m] between both ends of an arc, v [m/s] and omega [rad/s]; negative backwards, in space or in time. It points
    half way between the headings at both ends.
    """
    half = omega * seconds / 2
    return v * seconds * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)


def then(first: Motion, second: Motion) -> Motion:
    """Two motions, one after the other."""
    cos, sin = math.cos(first.turn), math.sin(first.turn)
    return Motion(
        first.x + cos * second.x - sin * second.y, first.y + sin * second.x + cos * second.y, first.turn + second.turn
    )


def inverse(motion: Motion) -> Motion:
    """The way back: where the robot was, seen from where it is."""
    x, y = carried(motion, 0.0, 0.0)
    return Motion(x, y, -motion.turn)


def carried(motion: Motion, x: float, y: float) -> Tuple[float, float]:
    """A point of the road, [m]: from the robot frame before the motion to the one after it."""
    cos, sin = math.cos(motion.turn), math.sin(motion.turn)
    ahead, left = x - motion.x, y - motion.y
    return cos * ahead + sin * left, cos * left - sin * ahead
