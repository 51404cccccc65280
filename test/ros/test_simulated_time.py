"""Who else may be on the master of a simulation or a recording; test_record has launch files that refuse."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

from typing import Any, List, Optional

import pytest

from obst_avoid.offline import simulated_time

CAMERA, WHEELS = '/duck2/camera_node/image', '/duck1/lane_controller_node/car_cmd'


class Master:
    """One that knows what the test says; a node whose name ends in _gone does not answer any more."""

    master_uri = 'http://somewhere:11311'

    def __init__(self, publishers: List[Any], subscribers: List[Any], services: List[Any]) -> None:
        self._state = publishers, subscribers, services

    def getSystemState(self) -> Any:
        return self._state


@pytest.mark.parametrize(
    'publishers, subscribers, services, why',
    [
        ([], [], [], None),
        ([['/rosout', ['/rosout', '/rviz']]], [[WHEELS, ['/recorder', '/duck2/wheels']]], [], None),
        ([['/clock', ['/player']]], [], [], '/player publishes /clock'),
        ([['/clock', ['/player_gone']]], [], [], None),
        ([[CAMERA, ['/duck2/camera_node']]], [], [], '/duck2/camera_node publishes ' + CAMERA),
        ([[CAMERA + '/compressed', ['/gone', '/duck2/b']]], [], [], '/duck2/b publishes %s/compressed' % CAMERA),
        ([], [[WHEELS, ['/duck1/wheels_driver_node']]], [], '/duck1/wheels_driver_node listens to ' + WHEELS),
        ([], [], [['/s', ['/duck1/obstacle_avoidance_node']]], '/duck1/obstacle_avoidance_node runs'),
        ([], [], [['/s', ['/duck2/obstacle_avoidance_node', '/duck1/rviz']]], None),
        ([['/duck1/plan', ['/x']]], [], [], '/x publishes /duck1/plan'),
    ],
)
def test_who_keeps_others_away(
    monkeypatch: pytest.MonkeyPatch, publishers: Any, subscribers: Any, services: Any, why: Optional[str]
) -> None:
    master = Master(publishers, subscribers, services)
    monkeypatch.setattr(simulated_time.rosgraph, 'Master', lambda name, uri: master)
    monkeypatch.setattr(simulated_time, '_lives', lambda master, node: not node.endswith('gone'))
    if why is None:
        simulated_time.require('duck1', ['/duck1/plan'])
        return
    with pytest.raises(simulated_time.NotAloneError) as error:
        simulated_time.require('duck1', ['/duck1/plan'])
    assert str(error.value).startswith(why + ' at http://somewhere:11311, expected nobody else there: end it, or unset')


def test_without_a_master_nobody_is_there() -> None:
    simulated_time.require('duck1', uri='http://localhost:1')


@pytest.mark.parametrize(
    'call, uri',
    [
        ([], ''),
        (['/usr/bin/python3', '/usr/bin/roslaunch', 'obst_avoid', 'replay.launch'], ''),
        (['/usr/bin/python3', '/usr/bin/roslaunch', '-p', '11312', 'a.launch'], 'http://localhost:11312'),
        (['/usr/bin/python3', '/usr/bin/roslaunch', '--port=11312', 'a.launch'], 'http://localhost:11312'),
        (['/usr/bin/python3', '/usr/bin/rostest', 'a.test'], None),
        (['/usr/bin/python3', '-m', 'pytest', '-p', 'plugin'], ''),
    ],
)
def test_the_master_is_the_one_that_roslaunch_takes(call: List[str], uri: Optional[str]) -> None:
    assert simulated_time.master_of(call) == uri
