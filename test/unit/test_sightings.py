"""Whether a detector keeps track, against the truth."""

from typing import Sequence, Tuple

import pytest

from obst_avoid.core.types import Kind, Obstacle
from obst_avoid.sim.sightings import NEAR, Sighting, Sightings, looked


def thing(x: float, y: float = 0.0) -> Obstacle:
    return Obstacle(Kind.DUCKIE, x, y, 0.03, True)


def after(*looks: Tuple[float, Sequence[Tuple[bool, Obstacle]], Sequence[Obstacle]]) -> Sightings:
    """The sightings after several reports; what is nearer than 0.15 m is out of the picture."""
    result = Sightings({})
    for time, there, report in looks:
        result = looked(result, time, there, report, lambda x, y: x > 0.15)
    return result


def test_the_clock_runs_from_coming_near() -> None:
    far, near = (True, thing(NEAR + 0.1)), (True, thing(NEAR - 0.1))
    found = after((0.0, [far], []), (1.0, [near], []), (1.1, [near], []), (1.2, [near], [thing(0.92, 0.03)]))
    assert found.of == {0: Sighting(1.0, pytest.approx(0.2), 0, True)}
    assert found.invented == 0


def test_what_was_known_before_it_came_near_is_known_at_once() -> None:
    found = after((0.0, [(True, thing(1.1))], [thing(1.1)]), (0.5, [(True, thing(0.9))], [thing(0.9)]))
    assert found.of == {0: Sighting(0.5, 0.0, 0, True)}


def test_each_gap_counts_once() -> None:
    there = [(True, thing(0.5))]
    found = after(
        (0, there, []), (1, there, [thing(0.5)]), (2, there, []), (3, there, []), (4, there, [thing(0.5)]),
        (5, there, []),
    )  # fmt: skip
    assert found.of[0] == Sighting(0, 1, 2, False)


@pytest.mark.parametrize('where', [thing(0.1), thing(-0.2), thing(1.5)])
def test_what_cannot_be_seen_cannot_be_lost(where: Obstacle) -> None:
    near = (True, thing(0.4))
    found = after((0, [near], [thing(0.4)]), (1, [(True, where)], []))
    assert found.of[0].lost == 0 and found.of[0].seen


def test_what_is_not_there_is_invented_once() -> None:
    there = [(True, thing(0.5))]
    ghost, another = thing(0.6, 0.4), thing(0.9, 0.9)
    found = after(
        (0, there, [thing(0.5), ghost]), (1, there, [thing(0.5), ghost]), (2, there, [ghost]),
        (3, there, [ghost, another]),
    )  # fmt: skip
    assert (found.invented, found.wrong) == (2, 2)


def test_two_reports_of_one_thing_are_one_too_many() -> None:
    found = after((0, [(True, thing(0.5))], [thing(0.5), thing(0.52, 0.02)]))
    assert found.invented == 1


def test_what_has_gone_is_not_invented() -> None:
    found = after((0, [(True, thing(0.5))], [thing(0.5)]), (1, [(False, thing(0.5))], [thing(0.5)]))
    assert found.invented == 0 and found.of[0].lost == 0


def test_the_nearest_pair_first() -> None:
    there = [(True, thing(0.5)), (True, thing(0.5, 0.12))]
    found = after((0, there, [thing(0.5, 0.1)]))
    assert 1 in found.of and found.of[1].after == 0 and found.of[0].after is None


def test_what_is_not_there_yet_is_invented() -> None:
    found = after((0, [(False, thing(0.5))], [thing(0.5)]))
    assert found.invented == 1 and not found.of
