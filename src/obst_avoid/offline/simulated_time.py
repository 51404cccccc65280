"""simulated_time: who plays a recording, or simulates a robot, must be alone with it on its ROS master.

Launch files ask before they have set or started anything: a node of a name that is there already would end that one,
and roslaunch's parameters would take the place of the robot's.
"""

import argparse
import os
import socket
import sys
import xmlrpc.client
from contextlib import suppress
from typing import Any, Iterator, Optional, Sequence, Tuple
from urllib.parse import urlsplit

import rosgraph

CLOCK = '/clock'
CAMERA = '/camera_node/image'
"""In the names of every Duckiebot's pictures."""
CAR_CMD = '/%s/lane_controller_node/car_cmd'
OURS = (
    'obstacle_detection_node',
    'obstacle_avoidance_node',
    'lane_controller_node',
    'car_cmd_guard_node',
    'daffy_adapter_node',
    'simulator_node',
    'replay_node',
    'player',
)
"""Nodes that decide, or that move something."""
WAIT = 1.0
"""[s] for a node to answer; the master remembers those, too, that were killed."""


class NotAloneError(RuntimeError):
    """The message is one sentence for a person."""


def require(veh: str, topics: Sequence[str] = (), uri: str = '') -> None:
    """Raises NotAloneError when a robot, another simulation or another recording is there; not when there is no master.

    veh: under whose name something will be played. topics: what must have no publisher yet. uri: of the master; empty:
    that of the environment.
    """
    master = rosgraph.Master('/simulated_time', uri or None)
    try:
        for node, what in _others(master, veh, topics):
            if _lives(master, node):
                sentence = '%s %s at %s, expected nobody else there: end it, or unset ROS_MASTER_URI'
                raise NotAloneError(sentence % (node, what, master.master_uri))
    except (OSError, rosgraph.MasterException, xmlrpc.client.Error):  # no master, or one that answers nonsense
        return


def _others(master: rosgraph.Master, veh: str, topics: Sequence[str]) -> Iterator[Tuple[str, str]]:
    publishers, subscribers, services = master.getSystemState()
    for topic, nodes in publishers:
        if topic == CLOCK or CAMERA in topic or topic in topics:
            yield from ((node, 'publishes ' + topic) for node in nodes)
    ours = {'/%s/%s' % (veh, name) for name in OURS}
    for _, nodes in publishers + subscribers + services:
        yield from ((node, 'runs') for node in nodes if node in ours)
    for topic, nodes in subscribers:
        if topic == CAR_CMD % veh:  # the wheels; others may look on
            yield from ((node, 'listens to ' + topic) for node in nodes if node.startswith('/%s/' % veh))


def _lives(master: rosgraph.Master, node: str) -> bool:
    with suppress(OSError, rosgraph.MasterException):
        address = urlsplit(master.lookupNode(node))
        with socket.create_connection((address.hostname, address.port), WAIT):
            return True
    return False


def main(arguments: Any = None) -> int:
    """Entry point of simulated_time, which launch files call while they are read."""
    parser = argparse.ArgumentParser(
        prog='simulated_time', description="Print 'true' where ROS time may be simulated, for launch files."
    )
    parser.add_argument('vehicle', metavar='NAME', help='of the robot that will be simulated, or was recorded')
    options = parser.parse_args(arguments)
    uri = master_of(_words_of(os.getppid()))
    try:
        if uri is not None:
            require(options.vehicle, uri=uri)
    except NotAloneError as error:
        print(error, file=sys.stderr)
        return 1
    sys.stdout.write('true')
    return 0


def master_of(call: Sequence[str]) -> Optional[str]:
    """Which master roslaunch will take, by its own command line. '': the environment's; None: a new one, as rostest."""
    programs = {os.path.basename(word) for word in call[:2]}  # Python's, and the script's
    if 'rostest' in programs:
        return None
    for word, following in zip(call, [*call[1:], '']) if 'roslaunch' in programs else ():
        if word in ('-p', '--port'):
            return 'http://localhost:' + following
        if word.startswith('--port='):
            return 'http://localhost:' + word[len('--port=') :]
    return ''


def _words_of(process: int) -> Sequence[str]:
    with suppress(OSError), open('/proc/%d/cmdline' % process, encoding='utf-8', errors='replace') as file:
        return file.read().split('\0')
    return ()
