"""Who plays a recording, or simulates a robot, must be alone with it on its ROS master."""

from typing import Sequence

import rosgraph

from obst_avoid.ros.node import NodeError

CLOCK, SIMULATED = '/clock', '/use_sim_time'
CAMERA = '/camera_node/image'
"""In the names of every Duckiebot's pictures."""


def require(name: str, topics: Sequence[str] = ()) -> None:
    """Raises NodeError when a node other than name publishes pictures, the clock, or one of topics.

    A recording beside the robot itself would tell its avoider of obstacles that are not there, and its clock would stop
    the robot's next node. The simulated time that our launch file has set there is taken back then.
    """
    master = rosgraph.Master(name)
    published = {topic: [node for node in nodes if node != name] for topic, nodes in master.getSystemState()[0]}
    for topic, nodes in published.items():
        if nodes and (topic == CLOCK or CAMERA in topic or topic in topics):
            if not published.get(CLOCK) and master.hasParam(SIMULATED):
                master.deleteParam(SIMULATED)
            sentence = '%s publishes %s at %s, expected a ROS master without a robot: unset ROS_MASTER_URI'
            raise NodeError(sentence % (nodes[0], topic, rosgraph.get_master_uri()))
