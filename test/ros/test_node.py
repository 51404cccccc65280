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


def test_parameters_of_a_new_master_do_not_take_the_place_of_those_that_are_kept() -> None:
    watch: Any = node.MasterWatch.__new__(node.MasterWatch)
    watch._parameters, watch._missing, watch._looks = {'/use_sim_time': True}, 0, node.LOOKS - 1
    watch._read = lambda: {'/use_sim_time': False}
    watch._is_known = lambda: False  # it was restarted a moment before it was read
    watch.look()
    assert watch._parameters == {'/use_sim_time': True}
    watch._looks, watch._is_known = node.LOOKS - 1, lambda: True
    watch.look()
    assert watch._parameters == {'/use_sim_time': False}
