"""ros.health: a robot's lines in /diagnostics, as a person reads them in rviz."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import given
from hypothesis import strategies as st

from obst_avoid.ros import node
from obst_avoid.ros.health import WIDTH, health_of, heard_of
from obst_avoid.ros.markers import markers_from_health

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
DETECTOR, AVOIDER = 'duck1/obstacle_detection_node: state', 'duck1/obstacle_avoidance_node: state'


def said(*lines: Any) -> DiagnosticArray:
    """lines: name, hardware id, level, message, calibration."""
    return DiagnosticArray(
        status=[
            DiagnosticStatus(level, name, message, hardware, [KeyValue('calibration', path)] if path else [])
            for name, hardware, level, message, path in lines
        ]
    )


def test_a_line_for_each_node_of_this_robot_in_the_order_of_the_data() -> None:
    heard = heard_of(
        said(
            (AVOIDER, 'duck1', OK, 'CLEAR: nothing', ''),
            ('duck2/obstacle_detection_node: state', 'duck2', ERROR, 'another robot', ''),
            ('somebody: disk', '', ERROR, 'full', ''),
            (DETECTOR, 'duck1', OK, '30.0 pictures/s', '/data/duck1.yaml'),
            ('duck1/own_node: state', 'duck1', OK, 'fine', ''),
        ),
        'duck1',
        wall=10.0,
    )
    words, level = health_of(heard, 10.5)
    assert words.split('\n') == [
        'detector: 30.0 pictures/s',
        'avoider: CLEAR: nothing',
        'own_node: fine',
        'calibration: /data/duck1.yaml',
    ]
    assert level == OK


@pytest.mark.parametrize(
    'levels, worst', [((OK, WARN), WARN), ((ERROR, WARN), ERROR), ((OK, 3), ERROR), ((OK, OK), OK)]
)
def test_the_worst_level_counts_and_is_said(levels: Any, worst: int) -> None:
    heard = heard_of(
        said((DETECTOR, 'duck1', levels[0], 'a', ''), (AVOIDER, 'duck1', levels[1], 'b', '')), 'duck1', 0.0
    )
    words, level = health_of(heard, 0.0)
    assert level == worst
    assert ('ERROR' in words, 'WARNING' in words) == (worst == ERROR, WARN in levels)


def test_a_node_that_has_fallen_silent_is_said_to_be() -> None:
    heard = heard_of(said((DETECTOR, 'duck1', OK, 'fine', '')), 'duck1', 0.0)
    assert health_of(heard, 2.9) == ('detector: fine', OK)
    assert health_of(heard, 7.2) == ('detector: SILENT for 7 s', ERROR)
    assert health_of({}, 7.2) == ('no diagnostics yet', WARN)


def test_two_calibrations_are_told_apart() -> None:
    both = said(
        (DETECTOR, 'duck1', OK, 'a', '/robot.yaml'),
        ('duck1/obstacle_detection_visual_node: state', 'duck1', OK, 'b', '/laptop.yaml'),
    )
    words, _ = health_of(heard_of(both, 'duck1', 0.0), 0.0)
    assert words.split('\n')[2:] == ['calibration of detector: /robot.yaml', 'calibration of visualizer: /laptop.yaml']


@given(st.text(alphabet='ab /', max_size=300))
def test_no_line_is_too_long_and_no_letter_is_lost(message: str) -> None:
    words, _ = health_of(heard_of(said((DETECTOR, 'duck1', OK, message, '')), 'duck1', 0.0), 0.0)
    assert max(len(line) for line in words.split('\n')) <= WIDTH
    assert ''.join(words.split()) == ''.join(('detector: ' + message).split())


def test_the_marker_is_text_in_the_colour_of_the_level() -> None:
    (fine,), (bad,) = (markers_from_health('words', level, 'duck1/footprint').markers for level in (OK, ERROR))
    assert fine.text == 'words' and fine.header.frame_id == 'duck1/footprint' and fine.type == fine.TEXT_VIEW_FACING
    assert fine.color.g > 0.8 > bad.color.r - 0.2 and bad.color.r > 0.8 > bad.color.g
    assert fine.lifetime.to_sec() > 1.0, 'it is said once a second'


@pytest.mark.parametrize(
    'value, form, words',
    [
        (None, '%.2f', 'none'),
        (-0.0004, '%.3f', '0.000'),
        (-0.5, '%.1f', '-0.5'),
        (-0.0, '%.0f', '0'),
        (-10, '%.0f', '-10'),
    ],
)
def test_figures(value: Any, form: str, words: str) -> None:
    assert node.figure(value, form) == words
