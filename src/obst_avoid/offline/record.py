"""record: what is needed to evaluate a drive, into a new folder: bags up to a size, the calibration, the settings.

The bags are written by rosbag, whose place this program takes when everything else is there.
"""

import argparse
import contextlib
import itertools
import os
import shutil
import sys
import time
from typing import Any, List, NoReturn, Tuple

import rosgraph
import rospy
import yaml

from obst_avoid.core.calibration import CalibrationError, find_calibration
from obst_avoid.core.settings import SettingsError
from obst_avoid.offline import tool
from obst_avoid.offline.recording import CAMERA_INFO, CAR_CMD, JPEG, LANE_POSE, MOTION, RAW, TURN
from obst_avoid.offline.recording import TOPICS as READ
from obst_avoid.offline.tool import ToolError
from obst_avoid.offline.tuning import settings as tuning
from obst_avoid.ros.node import path_of_user

NODES = (
    'obstacle_detection_node',
    'obstacle_avoidance_node',
    'obstacle_detection_visual_node',
    'lane_controller_node',
    'car_cmd_guard_node',
    'daffy_adapter_node',
    'simulator_node',
)
"""Whose settings are kept."""
TOPICS = (
    READ[CAMERA_INFO],
    READ[LANE_POSE],
    MOTION[CAR_CMD],
    MOTION[TURN],
    'obstacle_detection_node/posearray',
    'obstacle_detection_node/lane_pose',
    'obstacle_avoidance_node/lane_control',
    'obstacle_avoidance_node/obstacle_avoidance_active_flag',
    'obstacle_avoidance_node/markers',
    'simulator_node/scenario',
    'simulator_node/latency',
    'simulator_node/truth/pose',
    'simulator_node/truth/lane_pose',
    'simulator_node/truth/obstacles',
    'simulator_node/truth/gap',
    'simulator_node/truth/contact',
    *(name + '/parameter_updates' for name in NODES),
)
"""Under /<veh>, beside the pictures. That somebody listens to the avoider's markers makes it draw them: so intended."""
GLOBAL_TOPICS = ('/diagnostics', '/rosout', '/tf_static')
"""Without /clock: `rosbag play --clock` makes one."""
FEWEST = 20
"""[MB] Less does not divide into parts."""
PARTS = 10
"""How many bags share the size; the oldest goes when it is used up."""
MIB = 1 << 20
INDEX = 1.05
"""Ratio of a part's size, closed, to what rosbag stops at: the index is written last."""
SPARE = {'compressed': 1.0, 'raw': 5.0}
"""[MiB] The same: a picture more, and the messages' definitions."""
LEAST_FREE = '1G'
"""Of the disk, where rosbag stops writing."""


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='record',
        description='Record what is needed to evaluate a drive into a new folder: drive_0.bag and following, '
        'calibrations/, settings.yaml, and settings/ for --config and config:=. Ctrl-C ends it. drive_report, '
        "evaluate, run_bag and the launch files' bag:= take each of the bags.",
    )
    parser.add_argument('--vehicle', metavar='NAME', required=True, help='robot, whose topics are under /NAME')
    parser.add_argument('--output', metavar='DIR', default='.', help='where the new folder is made (default: here)')
    parser.add_argument(
        '--megabytes',
        type=_megabytes,
        default=2000,
        metavar='N',
        help='of all bags together; the oldest of %d parts goes when they are used up (default: 2000)' % PARTS,
    )
    parser.add_argument(
        '--calibration', metavar='DIR', default='', help='folder with camera_intrinsic/ and camera_extrinsic/'
    )
    parser.add_argument('--default-calibration', action='store_true', help="without files, keep the package's own")
    parser.add_argument(
        '--input', choices=tuple(SPARE), default='compressed', help='which pictures (default: %(default)s)'
    )
    parser.add_argument('--bag', metavar='FILE', help='only this one new bag, as large as it gets, instead of a folder')
    own = rospy.myargv(['record', *(sys.argv[1:] if arguments is None else arguments)])[1:]
    return tool.run(_main, parser, own)


def topics(veh: str, pictures: str) -> List[str]:
    """Full names of what is recorded. pictures: compressed or raw."""
    picture = READ[JPEG] if pictures == 'compressed' else READ[RAW]
    return ['/%s/%s' % (veh, name) for name in (picture, *TOPICS)] + list(GLOBAL_TOPICS)


def parts(megabytes: int, pictures: str) -> Tuple[int, int]:
    """Size at which rosbag begins a new part, MiB, and how many there may be so that all stay below megabytes."""
    limit = 0.99e6 * megabytes / MIB  # the rest is for calibration and settings
    size = max(1, int((limit / PARTS - SPARE[pictures]) / INDEX))
    return size, int(limit / (size * INDEX + SPARE[pictures]))


def _megabytes(value: str) -> int:
    with contextlib.suppress(ValueError):
        number = int(value)
        if number >= FEWEST:
            return number
    raise argparse.ArgumentTypeError('%s, expected a whole number >= %d (MB)' % (value, FEWEST))


def _main(options: argparse.Namespace) -> NoReturn:
    if not rosgraph.is_master_online():
        raise ToolError('no ROS master at %s, expected one that runs' % rosgraph.get_master_uri())
    call = ['rosrun', 'rosbag', 'record', '--repeat-latched', '--min-space=' + LEAST_FREE]
    if options.bag:
        call.append('--output-name=' + tool.new_file(path_of_user(options.bag)))
    else:
        folder = new_folder(path_of_user(options.output), options.vehicle)
        _keep_calibration(options, os.path.join(folder, 'calibrations'))
        _keep_settings(options.vehicle, folder)
        size, count = parts(options.megabytes, options.input)
        call += ['--output-name=' + os.path.join(folder, 'drive.bag'), '--split', '--size=%d' % size]
        call.append('--max-splits=%d' % (count - 1))  # beside the one that is being written
        print('record: into %s, %d MB at most' % (folder, options.megabytes), flush=True)
    names = [argument for argument in sys.argv[1:] if argument.startswith('__')]  # roslaunch's name for the node
    os.execvp(call[0], [*call, *topics(options.vehicle, options.input), *names])


def new_folder(output: str, veh: str) -> str:
    """Make a folder whose name has the time, and return its path. Raises OSError."""
    path = os.path.join(output, veh + time.strftime('_%Y-%m-%d_%H-%M-%S'))
    os.makedirs(output, exist_ok=True)
    for number in itertools.count(2):
        with contextlib.suppress(FileExistsError):
            os.mkdir(path)
            break
        path = '%s_%d' % (path.rsplit('_', 1)[0] if number > 2 else path, number)
    return path


def _keep_calibration(options: argparse.Namespace, folder: str) -> None:
    """Copies of the files in use, as the detector finds them."""
    own = os.path.join(tool.package_folder(), 'config/calibrations') if options.default_calibration else None
    try:
        source = find_calibration(options.vehicle, path_of_user(options.calibration), own).source
    except CalibrationError as error:
        print('record: without calibration: %s' % error, file=sys.stderr, flush=True)
        return
    for kind in ('camera_intrinsic', 'camera_extrinsic'):
        os.makedirs(os.path.join(folder, kind))
        found = os.path.join(os.path.dirname(os.path.dirname(source)), kind, os.path.basename(source))
        shutil.copyfile(found, os.path.join(folder, kind, options.vehicle + '.yaml'))


def _keep_settings(veh: str, folder: str) -> None:
    """All parameters of our nodes, as far as they run; and as a folder that tools and launch files take."""
    found = rospy.get_param('/' + veh, {})
    ours = {name: found[name] for name in NODES if isinstance(found, dict) and name in found}
    with open(os.path.join(folder, 'settings.yaml'), 'w', encoding='utf-8') as file:
        yaml.safe_dump({veh: ours}, file)
    values = {name: tuning.from_parameters(ours[name], name) for name in tuning.NODES if name in ours}
    values.update({name: ours[name] for name in tuning.OTHERS if name in ours})
    try:
        tuning.save(values, '', os.path.join(folder, 'settings'))
    except SettingsError as error:
        print('record: settings.yaml alone: %s' % error, file=sys.stderr, flush=True)
