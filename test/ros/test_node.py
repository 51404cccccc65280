"""What all nodes share, at their end: rospy closes the topics some time before it says that it is shut down."""

import threading
from typing import Any, List

import pytest
import rospy
from rospy import core

from obst_avoid.ros import node


def closed(*_: Any) -> None:
    raise rospy.ROSException('publish() to a closed topic')


@pytest.fixture
def faults(monkeypatch: pytest.MonkeyPatch) -> List[str]:
    """What a node would have said before it ended itself."""
    said: List[str] = []
    monkeypatch.setattr(node, '_end', said.append)
    return said


def run_thread(function: Any) -> None:
    before = set(threading.enumerate())
    node.in_background(function)
    for thread in set(threading.enumerate()) - before:
        thread.join(5)


def test_a_closed_topic_is_a_fault_while_the_node_lives(faults: List[str]) -> None:
    run_thread(closed)
    assert len(faults) == 1 and 'closed topic' in faults[0]
    with pytest.raises(rospy.ROSException):
        node.callback(closed)(None)


def test_a_closed_topic_is_no_fault_while_the_node_ends(faults: List[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def function() -> None:
        monkeypatch.setattr(core, '_in_shutdown', True)
        closed()

    run_thread(function)
    assert node.ending() and not rospy.is_shutdown()
    node.callback(closed)(None)
    assert faults == []


def test_a_timer_does_not_start_work_while_the_node_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(core, '_in_shutdown', True)
    calls: List[int] = []
    before = set(threading.enumerate())
    node.every(0.01, lambda: calls.append(1))
    for thread in set(threading.enumerate()) - before:
        thread.join(5)
        assert not thread.is_alive()
    assert calls == []
