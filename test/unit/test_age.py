"""core.age: how old a value is, and the sentence that refuses it."""

from typing import Optional

import pytest

from obst_avoid.core.age import age, why_stale, why_stopped
from obst_avoid.core.types import Stamped

NOW = 1_700_000_000_123_456_789
MS = 1_000_000


@pytest.mark.parametrize(
    'stamp, seconds',
    [(NOW, 0.0), (NOW - 250 * MS, 0.25), (NOW + 100 * MS, -0.1), (NOW - 1, 1e-9), (0, 1_700_000_000.123456789)],
)
def test_age_in_seconds(stamp: int, seconds: float) -> None:
    assert age(stamp, NOW) == pytest.approx(seconds, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize(
    'stamp, reason',
    [
        pytest.param(None, 'no lane pose yet', id='nothing came'),
        pytest.param(NOW, None, id='just now'),
        pytest.param(NOW - 400 * MS, None, id='as old as allowed'),
        pytest.param(NOW - 400 * MS - 1, 'lane pose is 0.40 s old, limit 0.40 s', id='a nanosecond too old'),
        pytest.param(NOW - 2500 * MS, 'lane pose is 2.50 s old, limit 0.40 s', id='old'),
        pytest.param(NOW + 100 * MS, None, id='as far ahead as allowed'),
        pytest.param(
            NOW + 100 * MS + 1, 'lane pose is stamped 0.10 s in the future, limit 0.10 s', id='a nanosecond too far'
        ),
        pytest.param(NOW + 60_000 * MS, 'lane pose is stamped 60.00 s in the future, limit 0.10 s', id='another clock'),
        pytest.param(0, 'lane pose is 1700000000.12 s old, limit 0.40 s', id='never stamped'),
    ],
)
def test_why_a_value_must_not_be_used(stamp: Optional[int], reason: Optional[str]) -> None:
    value = None if stamp is None else Stamped(stamp, 'anything')
    found = why_stale('lane pose', value, NOW, 0.4, 0.1)
    assert found is None if reason is None else found is not None and found.endswith(reason)


@pytest.mark.parametrize(
    'stood, reason',
    [
        pytest.param(0.0, None, id='moves'),
        pytest.param(0.5, None, id='as long as allowed'),
        pytest.param(0.51, 'the clock has stood still for 0.5 s, limit 0.5 s', id='a little longer'),
        pytest.param(12.34, 'the clock has stood still for 12.3 s, limit 0.5 s', id='long'),
    ],
)
def test_why_the_clock_must_not_be_trusted(stood: float, reason: Optional[str]) -> None:
    assert why_stopped(stood, 0.5) == reason
