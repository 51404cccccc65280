"""ros.markers: what the avoider shows comes back, and what is no plan is refused."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import io
import math
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point
from hypothesis import given
from hypothesis import strategies as st
from visualization_msgs.msg import MarkerArray

from obst_avoid.core.avoidance.corridor import View
from obst_avoid.core.types import Decision, State
from obst_avoid.ros import border
from obst_avoid.ros.markers import (
    markers_from_decision,
    markers_from_obstacles,
    reason_from_markers,
    state_from_markers,
    view_from_markers,
)

FRAME = 'duck1/footprint'
STAMP = 1_500_000_000_123_456_789
"""[ns] A stamp that a float would round."""

metres = st.floats(min_value=-10, max_value=10)
lines = st.lists(st.tuples(metres, metres), max_size=5).map(lambda points: np.array(points).reshape(-1, 2))
feet = st.one_of(st.none(), st.tuples(metres, metres, st.floats(min_value=1e-3, max_value=1)))
views = st.builds(View, region=lines, way=lines, deciding=feet)
decisions = st.builds(
    Decision,
    st.sampled_from(State),
    metres,
    st.just(0.0),
    st.sampled_from(['', 'slowing: 1 obstacle, no room', 'a\nb']),
)


def on_the_wire(msg: Any) -> Any:
    """The message as it arrives."""
    buffer = io.BytesIO()
    msg.serialize(buffer)
    return type(msg)().deserialize(buffer.getvalue())


@given(decisions, views)
def test_a_plan_comes_back(decision: Decision, view: View) -> None:
    msg = on_the_wire(markers_from_decision(decision, view, STAMP, FRAME))
    back = view_from_markers(msg)
    assert state_from_markers(msg) is decision.state
    assert reason_from_markers(msg) == decision.reason.replace('\n', ' ')
    assert (back.region == view.region).all() and back.region.shape == view.region.shape
    assert (back.way == view.way).all() and back.way.shape == view.way.shape
    assert (back.deciding is None) == (view.deciding is None)
    assert back.deciding == (view.deciding if view.deciding is None else pytest.approx(view.deciding))
    assert {border.nanoseconds(marker.header.stamp) for marker in msg.markers} == {STAMP}


def plan() -> MarkerArray:
    """Of two points each."""
    line = np.array([(0.0, 0.1), (1.0, 0.1)])
    return markers_from_decision(
        Decision(State.STOPPED, 0.0, 0.0, 'stopping'), View(line, line, (0.5, 0.0, 0.02)), STAMP, FRAME
    )


@pytest.mark.parametrize('msg', [MarkerArray(), markers_from_obstacles([], 2, STAMP, FRAME)], ids=['empty', 'others'])
def test_markers_that_are_no_plan(msg: MarkerArray) -> None:
    for read in (view_from_markers, state_from_markers):
        with pytest.raises(border.BorderError, match='the markers have no region, expected a decision'):
            read(msg)


@pytest.mark.parametrize('index, name', [(0, 'region'), (1, 'path'), (3, 'deciding')])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_numbers_that_are_none(index: int, name: str, value: float) -> None:
    msg = plan()
    msg.markers[index].points = [Point(0.1, value, 0.0)]
    msg.markers[index].pose.position.y = value
    with pytest.raises(border.BorderError, match='the marker %s has numbers that are none' % name):
        view_from_markers(msg)


def test_a_state_that_is_none() -> None:
    msg = plan()
    msg.markers[2].text = 'RESTING\nfor a while'
    with pytest.raises(border.BorderError, match="the markers have state 'RESTING', expected one of: CLEAR, SLOWING, "):
        state_from_markers(msg)
