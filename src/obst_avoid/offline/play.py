"""play: a recorded drive as the visualizer and rviz see it, on simulated time; nothing is computed anew.

rosbag plays it, whose place this program takes. What moves wheels is not played.
"""

import argparse
import os
import sys
from contextlib import suppress
from typing import Any, List, NoReturn

import rosgraph
import rospy

from obst_avoid.offline import simulated_time, tool
from obst_avoid.offline.recording import CAMERA_INFO, JPEG, LANE_POSE, open_bag
from obst_avoid.offline.recording import TOPICS as READ
from obst_avoid.offline.tool import ToolError
from obst_avoid.ros.node import path_of_user

PLAYED = (
    READ[CAMERA_INFO],
    READ[LANE_POSE],
    'obstacle_detection_node/posearray',
    'obstacle_detection_node/lane_pose',
    'obstacle_avoidance_node/markers',
)
"""Under /<veh>, beside the pictures."""
START_WAIT = 2.0
"""[s] for visualizer and rviz to subscribe."""


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='play', description='Play pictures, obstacle lists, plans and diagnostics of a recorded drive.'
    )
    parser.add_argument('path', metavar='BAG', help='a bag, or a folder that record made')
    parser.add_argument('--vehicle', metavar='NAME', required=True, help='robot that was recorded')
    parser.add_argument('--input', choices=('compressed', 'raw'), default='compressed', help='which pictures')
    parser.add_argument('--rate', type=_rate, default=1.0, metavar='R', help='recorded seconds a second (default: 1)')
    parser.add_argument('--loop', action='store_true', help='begin anew at the end')
    own = rospy.myargv(['play', *(sys.argv[1:] if arguments is None else arguments)])[1:]
    return tool.run(_main, parser, own)


def _rate(value: str) -> float:
    with suppress(ValueError):
        number = float(value)
        if 0.01 <= number <= 100:
            return number
    raise argparse.ArgumentTypeError('%s, expected 0.01 to 100 (recorded seconds a second)' % value)


def _main(options: argparse.Namespace) -> NoReturn:
    bags = bags_of(path_of_user(options.path))
    for bag in bags:
        found = open_bag(bag, options.vehicle).picture_role
        wanted = 'compressed' if found == JPEG else 'raw'
        if options.input != wanted:
            raise ToolError('%s has %s pictures, expected input:=%s' % (bag, wanted, wanted))
    if not rosgraph.is_master_online():
        raise ToolError('no ROS master at %s, expected one that runs' % rosgraph.get_master_uri())
    names = ['/%s/%s' % (options.vehicle, name) for name in (READ[found], *PLAYED)]
    try:
        simulated_time.require(options.vehicle, names)
    except simulated_time.NotAloneError as error:
        raise ToolError(str(error)) from error
    call = ['rosrun', 'rosbag', 'play', '--quiet', '--clock', '--delay=%g' % START_WAIT]
    call += ['--rate=%g' % options.rate, '--loop' if options.loop else '--keep-alive']  # the last picture stays
    call += ['clock:=/clock']  # rosbag has it in its own namespace
    call += [argument for argument in sys.argv[1:] if argument.startswith('__')]  # roslaunch's name for the node
    print('play: %s' % ', '.join(bags), flush=True)
    os.execvp(call[0], [*call, '--topics', *names, '/diagnostics', '--bags', *bags])


def bags_of(path: str) -> List[str]:
    """A bag, or those in a folder. Raises ToolError."""
    if not os.path.isdir(path):
        return [path]
    bags = [os.path.join(path, name) for name in tool.in_order(os.listdir(path)) if name.endswith('.bag')]
    if not bags:
        raise ToolError('%s has no bag, expected a folder that record made' % path)
    return bags
