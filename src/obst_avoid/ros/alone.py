"""Who plays a recording, or simulates a robot, must be alone with it on its ROS master."""

import socket
from contextlib import suppress
from typing import Sequence
from urllib.parse import urlsplit

import rosgraph

from obst_avoid.ros.node import NodeError

CLOCK, SIMULATED = '/clock', '/use_sim_time'
CAMERA = '/camera_node/image'
"""In the names of every Duckiebot's pictures."""
WAIT = 1.0
"""[s] for a node to answer; the master remembers those, too, that were killed."""


def require(name: str, topics: Sequence[str] = ()) -> None:
    """Raises NodeError when a node other than name publishes pictures, the clock, or one of topics.

    A recording beside the robot itself would tell its avoider of obstacles that are not there, and its clock would stop
    the robot's next node. The simulated time that our launch file has set there is taken back then.
    """
    master = rosgraph.Master(name)
    found = {
        topic: node
        for topic, nodes in master.getSystemState()[0]
        if topic == CLOCK or CAMERA in topic or topic in topics
        for node in nodes
        if node != name and _lives(master, node)
    }
    if CLOCK not in found and found and master.hasParam(SIMULATED):
        master.deleteParam(SIMULATED)
    for topic, node in found.items():
        sentence = '%s publishes %s at %s, expected a ROS master without a robot: unset ROS_MASTER_URI'
        raise NodeError(sentence % (node, topic, rosgraph.get_master_uri()))


def _lives(master: rosgraph.Master, node: str) -> bool:
    with suppress(OSError, rosgraph.MasterException):
        address = urlsplit(master.lookupNode(node))
        with socket.create_connection((address.hostname, address.port), WAIT):
            return True
    return False
