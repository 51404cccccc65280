"""core.motion: where the robot is by what it was told."""

import math
from typing import Any, Optional, Sequence, Tuple

import pytest

from obst_avoid.core.motion import HISTORY, Motion, arc, carried, inverse, motion_between, remembered, then
from obst_avoid.core.types import Command, Stamped

MS = 1_000_000
"""[ns]"""
START = 1_700_000_000_123_456_789
STOP, STRAIGHT, SPIN = Command(0.0, 0.0), Command(0.2, 0.0), Command(0.0, 1.0)


def told(*commands: Tuple[int, Command]) -> Tuple[Stamped[Command], ...]:
    """Commands and when they were given. [ms]"""
    return tuple(Stamped(START + ms * MS, command) for ms, command in commands)


def between(commands: Any, since: int, until: int) -> Optional[Motion]:
    """since, until: [ms]"""
    return motion_between(commands, START + since * MS, START + until * MS, 0.5)


@pytest.mark.parametrize(
    'commands, since, until, wanted',
    [
        pytest.param((), 0, 100, None, id='nobody said anything'),
        pytest.param(((0, STRAIGHT),), 0, 0, (0, 0, 0), id='no time'),
        pytest.param(((0, STRAIGHT),), 100, 0, None, id='time ran backwards'),
        pytest.param(((0, STOP),), 0, 400, (0, 0, 0), id='stands'),
        pytest.param(((0, STRAIGHT),), 0, 400, (0.08, 0, 0), id='straight'),
        pytest.param(((0, SPIN),), 0, 400, (0, 0, 0.4), id='turns left on the spot'),
        pytest.param(((0, Command(-0.2, 0.0)),), 0, 100, (-0.02, 0, 0), id='backwards'),
        pytest.param(
            ((0, Command(0.5 * math.pi, math.pi)),), 0, 500, (0.5, 0.5, math.pi / 2), id='a quarter of a circle'
        ),
        pytest.param(((0, STRAIGHT), (100, STOP)), 0, 200, (0.02, 0, 0), id='the next command takes over'),
        pytest.param(((0, STRAIGHT), (100, STOP)), 50, 200, (0.01, 0, 0), id='begins within a command'),
        pytest.param(((0, STRAIGHT), (100, STOP)), 0, 50, (0.01, 0, 0), id='ends within a command'),
        pytest.param(((0, STRAIGHT), (100, STOP)), 100, 150, (0, 0, 0), id='begins with a command'),
        pytest.param(((0, STRAIGHT), (100, STOP), (300, STRAIGHT)), 100, 200, (0, 0, 0), id='later ones do not count'),
        pytest.param(((0, STRAIGHT), (0, STOP)), 0, 100, (0, 0, 0), id='of two at once the later one'),
        pytest.param(
            ((0, SPIN), (100, STRAIGHT)), 0, 200, (0.02 * math.cos(0.1), 0.02 * math.sin(0.1), 0.1),
            id='turns, then drives',
        ),
        pytest.param(((50, STRAIGHT),), 0, 100, (0.02, 0, 0), id='the first one counts a moment back'),
        pytest.param(((500, STRAIGHT),), 0, 500, (0.1, 0, 0), id='as far back as allowed'),
        pytest.param(((501, STRAIGHT),), 0, 600, None, id='too far back'),
        pytest.param(((200, STRAIGHT),), 0, 100, (0.02, 0, 0), id='all before the first'),
        pytest.param(((0, STRAIGHT),), 300, 500, (0.04, 0, 0), id='as long as allowed'),
        pytest.param(((0, STRAIGHT),), 300, 501, None, id='silent for too long'),
        pytest.param(((0, STRAIGHT), (600, STOP)), 550, 650, None, id='was silent for too long, and spoke again'),
        pytest.param(((0, STRAIGHT), (600, STOP)), 600, 650, (0, 0, 0), id='spoke again in time'),
    ],
)  # fmt: skip
def test_how_the_robot_moved(
    commands: Sequence[Tuple[int, Command]], since: int, until: int, wanted: Optional[Tuple[float, float, float]]
) -> None:
    found = between(told(*commands), since, until)
    if wanted is None:
        assert found is None
    else:
        assert found is not None
        assert (found.x, found.y, found.turn) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(
    'motion, before, after',
    [
        pytest.param(Motion(), (0.5, 0.1), (0.5, 0.1), id='stood'),
        pytest.param(Motion(0.2, 0.0, 0.0), (0.5, 0.1), (0.3, 0.1), id='what is ahead comes nearer'),
        pytest.param(Motion(0.0, 0.0, math.pi / 2), (0.5, 0.1), (0.1, -0.5), id='turned left: what was ahead is right'),
        pytest.param(Motion(0.5, 0.5, math.pi / 2), (0.5, 0.6), (0.1, 0.0), id='a quarter of a circle'),
    ],
)
def test_where_a_point_of_the_road_goes(motion: Motion, before: Any, after: Any) -> None:
    assert carried(motion, *before) == pytest.approx(after, abs=1e-12)


def test_an_arc_and_many_short_ones_are_the_same() -> None:
    command, whole = Command(0.3, -2.0), Motion()
    for _ in range(100):
        whole = then(whole, arc(command, 0.01))
    found = arc(command, 1.0)
    assert (found.x, found.y, found.turn) == pytest.approx((whole.x, whole.y, whole.turn), abs=1e-12)


@pytest.mark.parametrize(
    'motion, back',
    [
        pytest.param(Motion(), (0.0, 0.0, 0.0), id='stood'),
        pytest.param(Motion(0.2, 0.0, 0.0), (-0.2, 0.0, 0.0), id='straight on'),
        pytest.param(Motion(0.2, -0.1, 0.0), (-0.2, 0.1, 0.0), id='slantwise'),
        pytest.param(Motion(0.0, 0.0, 0.3), (0.0, 0.0, -0.3), id='turned on the spot'),
        pytest.param(Motion(0.5, 0.5, math.pi / 2), (-0.5, 0.5, -math.pi / 2), id='a quarter of a left circle'),
        pytest.param(Motion(0.5, -0.5, -math.pi / 2), (-0.5, -0.5, math.pi / 2), id='a quarter of a right circle'),
        pytest.param(Motion(0.4, 0.1, math.pi), (0.4, 0.1, -math.pi), id='looks back'),
        pytest.param(Motion(0.3, 0.1, 7.0), None, id='more than once around'),
        pytest.param(arc(Command(-0.2, -3.0), 0.7), None, id='an arc backwards'),
    ],
)  # fmt: skip
def test_the_way_back(motion: Motion, back: Optional[Tuple[float, float, float]]) -> None:
    found = inverse(motion)
    if back is not None:
        assert (found.x, found.y, found.turn) == pytest.approx(back, abs=1e-12)
    for first, second in ((motion, found), (found, motion)):
        nothing = then(first, second)
        assert (nothing.x, nothing.y, nothing.turn) == pytest.approx((0, 0, 0), abs=1e-12)
    again = inverse(found)
    assert (again.x, again.y, again.turn) == pytest.approx((motion.x, motion.y, motion.turn), abs=1e-12)
    assert carried(found, *carried(motion, 0.5, 0.1)) == pytest.approx((0.5, 0.1), abs=1e-12)


def test_the_way_back_of_two_motions_begins_with_the_second() -> None:
    first, second = Motion(0.3, -0.1, 0.8), Motion(0.1, 0.2, -1.5)
    found, wanted = inverse(then(first, second)), then(inverse(second), inverse(first))
    assert (found.x, found.y, found.turn) == pytest.approx((wanted.x, wanted.y, wanted.turn), abs=1e-12)


class TestMemory:
    def test_the_first(self) -> None:
        assert remembered((), Stamped(START, STOP)) == told((0, STOP))

    def test_the_next(self) -> None:
        first = told((0, STOP))
        assert remembered(first, Stamped(START + 50 * MS, SPIN)) == told((0, STOP), (50, SPIN))

    def test_what_is_too_old_goes(self) -> None:
        commands = told((0, STOP), (1, STRAIGHT))
        newest = Stamped(START + int(HISTORY * 1e9) + MS, SPIN)
        assert remembered(commands, newest) == (commands[1], newest)

    def test_time_that_runs_backwards_begins_anew(self) -> None:
        assert remembered(told((100, STRAIGHT), (200, STRAIGHT)), Stamped(START + 150 * MS, STOP)) == told((150, STOP))
