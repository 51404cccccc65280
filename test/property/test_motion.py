"""core.motion: a way is the sum of its parts, and a mirrored robot drives a mirrored way."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obst_avoid.core.motion import Motion, arc, carried, motion_between, then
from obst_avoid.core.types import Command, Stamped
from property.strategies import numbers

MS = 1_000_000
commands = st.lists(
    st.builds(
        Stamped,
        stamp=st.integers(0, 1000).map(MS.__mul__),
        value=st.builds(Command, numbers(-0.5, 0.5), numbers(-4, 4)),
    ),
    max_size=8,
).map(lambda given: sorted(given, key=lambda item: item.stamp))
times = st.integers(-100, 1200).map(MS.__mul__)
motions = st.builds(Motion, numbers(-1, 1), numbers(-1, 1), numbers(-3, 3))


def close(one: Motion, other: Motion) -> bool:
    return (one.x, one.y, one.turn) == pytest.approx((other.x, other.y, other.turn), abs=1e-9)


@given(told=commands, moments=st.tuples(times, times, times).map(sorted))
def test_two_parts_make_the_whole(told: Any, moments: Any) -> None:
    since, middle, until = moments
    whole = motion_between(told, since, until)
    if whole is not None:
        first, second = motion_between(told, since, middle), motion_between(told, middle, until)
        assert first is not None and second is not None, 'what is known as a whole is known in parts'
        assert close(then(first, second), whole)


@given(told=commands, moments=st.tuples(times, times).map(sorted))
def test_a_mirrored_robot_drives_a_mirrored_way(told: Any, moments: Any) -> None:
    found = motion_between(told, *moments)
    flipped = [Stamped(item.stamp, Command(item.value.v, -item.value.omega)) for item in told]
    mirrored = motion_between(flipped, *moments)
    assert (found is None) is (mirrored is None)
    if found is not None and mirrored is not None:
        assert close(mirrored, Motion(found.x, -found.y, -found.turn))


@given(v=numbers(-0.5, 0.5), omega=numbers(-4, 4), seconds=numbers(0, 2))
def test_who_drives_back_the_same_way_arrives_where_he_began(v: float, omega: float, seconds: float) -> None:
    there, back = arc(Command(v, omega), seconds), arc(Command(-v, -omega), seconds)
    assert close(then(there, back), Motion())


@given(first=motions, second=motions, x=numbers(-2, 2), y=numbers(-2, 2))
def test_points_are_carried_by_each_part(first: Motion, second: Motion, x: float, y: float) -> None:
    assert carried(then(first, second), x, y) == pytest.approx(carried(second, *carried(first, x, y)), abs=1e-9)
