"""The drawn recording gives what it gave when somebody last looked at it, within stated tolerances."""

import json
import re
from typing import Any, Dict, List

import pytest

from golden.recording import FRAMES, PATH, replayed

TOLERANCES: Dict[str, float] = {
    'x': 0.015,  # m; two pixels of the bird view: OpenCV's versions differ in single pixels at the edge of a colour
    'y': 0.015,
    'radius': 0.015,
    'd_ref': 0.015,
    'confidence': 0.05,
    'bird_box': 2.01,  # px
    'image_box': 4.0,  # px; near the robot a pixel of the bird view is four of the picture
}
"""Numbers without one must be equal."""


@pytest.fixture(scope='module')
def now() -> List[Dict[str, Any]]:
    """What the code gives today."""
    return replayed()


@pytest.fixture(scope='module')
def then() -> List[Dict[str, Any]]:
    """What is committed."""
    answers: List[Dict[str, Any]] = json.loads(PATH.read_text())
    return answers


def differences(now: Any, then: Any, where: str, tolerance: float = 0.0) -> List[str]:
    """Every field that differs, by its full name, with both values."""
    if isinstance(now, dict) and isinstance(then, dict) and now.keys() == then.keys():
        pairs = [(now[key], then[key], where + '/' + key, TOLERANCES.get(key, tolerance)) for key in now]
        return [found for pair in pairs for found in differences(*pair)]
    if isinstance(now, list) and isinstance(then, list) and len(now) == len(then):
        pairs = [(here, there, '%s[%d]' % (where, i), tolerance) for i, (here, there) in enumerate(zip(now, then))]
        return [found for pair in pairs for found in differences(*pair)]
    if type(now) in (int, float) and type(then) in (int, float):  # not bool
        same = abs(now - then) <= tolerance
    elif isinstance(now, str) and isinstance(then, str):
        same = without_numbers(now) == without_numbers(then)
    else:
        same = type(now) is type(then) and now == then
    return [] if same else ['%s: %r, committed %r' % (where, now, then)]


def without_numbers(reason: str) -> str:
    """A reason with its measured numbers blanked; counts, which have no point, stay."""
    return re.sub(r'[-+]?\d+\.\d+', '#', reason)


def test_every_field_of_every_frame_is_as_committed(now: List[Dict[str, Any]], then: List[Dict[str, Any]]) -> None:
    assert '\n'.join(differences(now, then, 'frame')) == ''


def test_the_recording_shows_what_it_is_for(then: List[Dict[str, Any]]) -> None:
    states = [answer['decision']['state'] for answer in then]
    assert len(then) == len(FRAMES) and states == sorted(states, key=['CLEAR', 'SLOWING', 'STOPPED'].index)
    assert len(set(states)) == 3
    reasons = {answer['decision']['reason'].split(':')[0] for answer in then}
    assert reasons == {'clear', 'slowing', 'stopping', 'waiting'}, 'no room behind the duckie, so it stops before both'
    seen = [(one['kind'], one['in_lane']) for answer in then for one in answer['obstacles']]
    assert {('duckie', True), ('cone', True), ('cone', False)} <= set(seen)


@pytest.mark.parametrize(
    'change, found',
    [
        pytest.param({'x': 0.514}, [], id='within the tolerance'),
        pytest.param({'x': 0.516}, ['frame/x: 0.516, committed 0.5'], id='beyond the tolerance'),
        pytest.param({'kind': 'cone'}, ["frame/kind: 'cone', committed 'duckie'"], id='another kind'),
        pytest.param({'in_lane': None}, ['frame/in_lane: None, committed True'], id='another side'),
        pytest.param({'bird_box': {'top': 5}}, [], id='a box within two pixels'),
        pytest.param({'bird_box': {'top': 6}}, ['frame/bird_box/top: 6, committed 3'], id='a box elsewhere'),
        pytest.param({'in_lane': 1}, ['frame/in_lane: 1, committed True'], id='a number for a flag'),
        pytest.param({'count': 3}, ['frame/count: 3, committed 2'], id='a number without tolerance'),
        pytest.param({'reason': 'at 0.52 m'}, [], id='another number in a reason'),
        pytest.param(
            {'reason': 'near 0.5 m'}, ["frame/reason: 'near 0.5 m', committed 'at 0.5 m'"], id='another reason'
        ),
    ],
)
def test_the_comparison_sees_what_differs(change: Dict[str, Any], found: List[str]) -> None:
    base = {'kind': 'duckie', 'x': 0.5, 'in_lane': True, 'bird_box': {'top': 3}, 'reason': 'at 0.5 m', 'count': 2}
    assert differences(dict(base, **change), base, 'frame') == found


def test_the_comparison_sees_missing_and_additional_fields() -> None:
    assert differences([{'x': 1.0}], [], 'frame') and differences({'x': 1.0}, {'y': 1.0}, 'frame')
