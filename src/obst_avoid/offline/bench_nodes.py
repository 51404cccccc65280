"""What bench puts around the real nodes: a camera, with the lane pose and the command that go with it, and a listener.

Each is a process of its own that bench talks with: a line on stdout says how far it is, a line on stdin lets it go on.
Stamps and arrivals are the system's time in ns, which is ROS time here.
"""

import argparse
import json
import pickle
import sys
import time
from typing import Any, Callable, Dict, List, Sequence, TextIO, Tuple

import rospy
from geometry_msgs.msg import PoseArray
from sensor_msgs.msg import CompressedImage

from obst_avoid.core.types import Command, LanePose
from obst_avoid.msg import LaneControl
from obst_avoid.offline.recording import CAR_CMD, JPEG, LANE_POSE, MOTION, TOPICS
from obst_avoid.ros import border
from obst_avoid.ros.messages import find_messages

CAMERA, LISTENER = 'camera', 'listener'
START_WAIT = 30.0
"""[s] for the nodes to come up."""
SPEED = 0.2
"""[m/s] of the command that is published."""


def main() -> None:
    """Entry point of both."""
    parser = argparse.ArgumentParser()
    parser.add_argument('role', choices=(CAMERA, LISTENER))
    parser.add_argument('veh')
    parser.add_argument('--pictures', help='file with a pickled list of JPEGs')
    parser.add_argument('--warm-up', type=int, help='pictures that are not counted')
    parser.add_argument('--count', type=int, help='pictures that are')
    parser.add_argument('--rate', type=float, help='pictures a second')
    options = parser.parse_args()
    say_to, sys.stdout = sys.stdout, sys.stderr  # rospy's own words must not get in between
    rospy.init_node('bench_' + options.role)
    if options.role == LISTENER:
        _listen(options.veh, say_to)
    else:
        with open(options.pictures, 'rb') as file:
            jpegs = pickle.load(file)
        _show(jpegs, options, say_to)


def _show(jpegs: Sequence[bytes], options: argparse.Namespace, say_to: TextIO) -> None:
    """Publish pictures at a steady rate, each with the time of its publishing as stamp; say all stamps at the end."""
    veh, classes = options.veh, find_messages('')
    image = rospy.Publisher('/%s/%s' % (veh, TOPICS[JPEG]), CompressedImage, queue_size=1)
    pose = rospy.Publisher('/%s/%s' % (veh, TOPICS[LANE_POSE]), classes.LanePose, queue_size=1)
    command = rospy.Publisher('/%s/%s' % (veh, MOTION[CAR_CMD]), classes.Twist2DStamped, queue_size=1)
    _wait(lambda: min(topic.get_num_connections() for topic in (image, pose, command)))
    _say('ready', say_to)
    sys.stdin.readline()
    stamps: List[int] = []
    begin = time.monotonic()
    for index in range(options.warm_up + options.count):
        time.sleep(max(0.0, begin + index / options.rate - time.monotonic()))
        if index == options.warm_up:
            _say('begin', say_to)
        stamp = time.time_ns()
        stamps.append(stamp)
        pose.publish(border.msg_from_lane_pose(LanePose(0.0, 0.0), stamp, classes.LanePose))
        command.publish(border.msg_from_command(Command(SPEED, 0.0), stamp, classes.Twist2DStamped))
        jpeg = jpegs[index % len(jpegs)]
        image.publish(border.compressed_image_from_jpeg(jpeg, stamp, border.camera_frame(veh)))
    time.sleep(max(0.0, begin + len(stamps) / options.rate - time.monotonic()))
    _say(stamps[options.warm_up :], say_to)
    sys.stdin.readline()  # the last picture may still be on its way


def _listen(veh: str, say_to: TextIO) -> None:
    """Note when which stamp comes, and say it when asked."""
    heard: Dict[str, List[Tuple[int, int]]] = {'posearray': [], 'lane_control': []}

    def note(name: str) -> Callable[[Any], None]:
        return lambda msg: heard[name].append((border.nanoseconds(msg.header.stamp), time.time_ns()))

    topics = {'posearray': 'obstacle_detection_node/posearray', 'lane_control': 'obstacle_avoidance_node/lane_control'}
    subscribers = [
        rospy.Subscriber('/%s/%s' % (veh, topics[name]), cls, note(name), queue_size=100, tcp_nodelay=True)
        for name, cls in (('posearray', PoseArray), ('lane_control', LaneControl))
    ]
    _wait(lambda: min(subscriber.get_num_connections() for subscriber in subscribers))
    _say('ready', say_to)
    sys.stdin.readline()
    _say(heard, say_to)


def _wait(look: Callable[[], int]) -> None:
    end = time.monotonic() + START_WAIT
    while not look():
        if time.monotonic() > end or rospy.core.is_shutdown_requested():
            sys.exit(1)
        time.sleep(0.05)


def _say(what: Any, say_to: TextIO) -> None:
    print(json.dumps(what), file=say_to, flush=True)


if __name__ == '__main__':
    main()
