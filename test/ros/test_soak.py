"""soak: what it takes for a fault, and half a minute of it."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import json
from pathlib import Path
from typing import Any, Dict

import pytest
from helpers import run_program

from obst_avoid.offline.soak import APART, judged, scenario

GOOD: Dict[str, Any] = {
    'minutes asked for': 20.0,
    'minutes': 20.0,
    'stops': 20,
    'metres': 150.0,
    'decision at the end': 'state 0, clear',
    'memory at the beginning [MB]': {'a': 100.0},
    'memory at the end [MB]': {'a': 105.0},
    'latency of the first quarter, p95 [ms]': 20.0,
    'latency of the last quarter, p95 [ms]': 25.0,
    'stops without a cause': [],
    'faults': [],
}


@pytest.mark.parametrize(
    'change, words',
    [
        ({}, ''),
        ({'memory at the end [MB]': {'a': 120.0}}, 'a grew from 100.0 to 120.0 MB'),
        ({'latency of the last quarter, p95 [ms]': 60.0}, 'answers took 20.0 ms at the beginning and 60.0 ms'),
        ({'memory at the end [MB]': {}}, 'a is gone'),
        ({'minutes': 12.0}, 'it ended after 12.0 of 20.0 minutes'),
        ({'stops': 3}, '3 stops, expected at least 10, on 150.0 m, and at the end state 0, clear'),
        ({'stops without a cause': ['after 3.1 m: why', 'x', 'y']}, '3 stops without a cause: after 3.1 m: why'),
        ({'stops without a cause': ['x', 'y']}, ''),
        ({'faults': ['stopping: no lane pose yet']}, '1 faults: stopping: no lane pose yet'),
    ],
)
def test_what_is_wrong(change: Dict[str, Any], words: str) -> None:
    wrong = judged({**GOOD, **change})
    assert [sentence for sentence in wrong if words in sentence] == wrong
    assert bool(wrong) is bool(words)


def test_the_drive_is_as_long_as_asked_for() -> None:
    short, long = scenario(1.0), scenario(20.0)
    assert short['success']['goal'] < long['success']['goal']
    alongs = [thing['along'] for thing in long['obstacles']]
    assert len(alongs) > 15 and max(b - a for a, b in zip(alongs, alongs[1:])) == pytest.approx(APART)
    # The way goes round and round: what was there from the beginning stood under the robot, several laps ahead.
    assert all(0 < thing['appears_within'] < APART / 2 for thing in long['obstacles'])


def test_half_a_minute(tmp_path: Path) -> None:
    ended = run_program(['rosrun', 'obst_avoid', 'soak', '--minutes', '0.5', '--output', str(tmp_path / 'a.json')], 180)
    figures = json.loads((tmp_path / 'a.json').read_text())
    assert figures['pictures answered'] > 100, ended.output
    assert figures['metres'] > 1, ended.output
    assert set(figures['memory at the end [MB]']) > {'obstacle_detection_node', 'obstacle_avoidance_node'}
    assert not figures['stops without a cause'] and 'Traceback' not in ended.output, ended.output
