#!/usr/bin/env python3
"""Nodes with one thing wrong end at once, with one sentence that names it; nodes with nothing wrong end in peace."""

import functools
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Dict, Tuple

import rospy
import rostest
from helpers import (
    REPOSITORY,
    START,
    Ended,
    Inbox,
    Prepared,
    Repeating,
    load_launch,
    publisher,
    publishers_of,
    run_program,
    wait_for,
)
from roslib.packages import find_node
from std_msgs.msg import Header

from obst_avoid.msg import LaneControl, LanePose, Twist2DStamped

LIMIT = 15.0
"""[s] within which a node must have given up."""
DETECTOR, AVOIDER = 'obstacle_detection_node', 'obstacle_avoidance_node'
CONTROLLER, VISUALIZER, REPLAY = 'lane_controller_node', 'obstacle_detection_visual_node', 'replay_node'
WITHOUT = object()
"""Stands for a parameter that is taken away."""


@dataclass(frozen=True)
class Case:
    """node: its type. changes: of the parameters that replay.launch gives it; {folder} is a folder of calibrations.

    words: what its last sentence must contain.
    """

    node: str
    changes: Dict[str, Any]
    words: Tuple[str, ...]
    environment: Dict[str, str] = field(default_factory=dict)


CASES = {
    'setting_out_of_range': Case(
        AVOIDER, {'lane_width': -0.2}, ('/{node}/lane_width = -0.2, expected a number > 0 (m)',)
    ),
    'setting_of_another_type': Case(
        CONTROLLER, {'cruise_speed': 'fast'}, ("/{node}/cruise_speed = 'fast', expected a number",)
    ),
    'setting_misspelt': Case(
        AVOIDER, {'lane_width': WITHOUT, 'lane_widht': 0.22}, ('/{node}/lane_widht is not a setting', 'lane_width')
    ),
    'nested_setting_out_of_range': Case(
        DETECTOR, {'paper/yellow/low': [15, 100, 300]}, ('/{node}/paper/yellow/low = [15, 100, 300]', '0 to 255')
    ),
    'unknown_stage': Case(
        AVOIDER, {'stage': 'avoid_everything'}, ("/{node}/stage = 'avoid_everything'", 'avoid_single')
    ),
    'unknown_profile': Case(
        DETECTOR, {'profile': 'magic'}, ("/{node}/profile = 'magic', expected one of: robust, paper",)
    ),
    'no_calibration': Case(
        DETECTOR,
        {'veh': 'nobody', 'allow_default_calibration': False, 'calibration_dir': '{folder}'},
        ('nobody', 'camera_intrinsic/nobody.yaml', '{folder}', '/data/config/calibrations', '/fleet/calibrations'),
        {'DUCKIEFLEET_ROOT': '/fleet'},
    ),
    'relative_calibration_folder': Case(
        DETECTOR,
        {'calibration_dir': 'no_such_folder'},
        ('calibration_dir = /where/roslaunch/was/called/no_such_folder, expected an existing folder',),
        {'PWD': '/where/roslaunch/was/called'},
    ),
    'calibration_that_is_no_yaml': Case(
        DETECTOR,
        {'veh': 'broken', 'calibration_dir': '{folder}'},
        ('{folder}/camera_extrinsic/broken.yaml', 'does not parse as YAML at line 3'),
    ),
    'half_a_calibration': Case(
        VISUALIZER,
        {'veh': 'half', 'calibration_dir': '{folder}'},
        ('{folder}/camera_extrinsic/half.yaml cannot be read',),
    ),
    'vehicle_with_a_slash': Case(DETECTOR, {'veh': 'duck/1'}, ("'duck/1', expected the plain name of a robot",)),
    'unknown_messages_for_the_avoider': Case(
        AVOIDER, {'msgs_package': 'no_such_msgs'}, ('msgs_package = no_such_msgs',)
    ),
    'no_bag': Case(REPLAY, {'bag': '/no/such.bag'}, ('/no/such.bag does not exist, expected a bag',)),
}


class StartErrors(Prepared):
    @classmethod
    def prepare(cls) -> None:
        cls.folder = tempfile.mkdtemp(prefix='obst_avoid_')
        for kind, names in (('camera_intrinsic', ('broken', 'half')), ('camera_extrinsic', ('broken',))):
            os.makedirs(os.path.join(cls.folder, kind))
            for name in names:
                source = REPOSITORY / 'config' / 'calibrations' / kind / 'default.yaml'
                shutil.copy(str(source), os.path.join(cls.folder, kind, name + '.yaml'))
        with open(os.path.join(cls.folder, 'camera_extrinsic', 'broken.yaml'), 'w') as file:
            file.write('# a comment\nhomography: [0.0, 1.0\nformat: }\n')
        pool = ThreadPoolExecutor(2)
        cls.ended = {name: pool.submit(cls.start, name, case) for name, case in CASES.items()}

    @classmethod
    def start(cls, name: str, case: Case) -> Ended:
        """Run one node with its parameters under a namespace of its own, until it ends."""
        set_parameters(name, case.node)
        for key, value in case.changes.items():
            full = '/%s/%s/%s' % (name, case.node, key)
            if value is WITHOUT:
                rospy.delete_param(full)
            else:
                rospy.set_param(full, value.format(folder=cls.folder) if isinstance(value, str) else value)
        return run_program([program(case.node), '__ns:=' + name], LIMIT, case.environment)

    def check(self, name: str) -> None:
        case, ended = CASES[name], self.ended[name].result()
        self.assertNotEqual(ended.code, 0, ended.output)
        lines = [line for line in ended.output.splitlines() if line.strip() and '[INFO]' not in line]
        self.assertEqual(len(lines), 1, ended.output)
        self.assertIn('[FATAL]', lines[0])
        for words in case.words:
            self.assertIn(words.format(node='%s/%s' % (name, case.node), folder=self.folder), lines[0])
        self.assertNotIn('Traceback', ended.output)

    def test_without_parameters_a_node_names_the_first_that_is_missing(self) -> None:
        ended = run_program([program(AVOIDER), '__ns:=bare'], LIMIT)
        self.assertEqual(ended.code, 1, ended.output)
        self.assertIn('/bare/obstacle_avoidance_node/stage is missing', ended.output)
        self.assertNotIn('Traceback', ended.output)

    def test_nodes_with_nothing_wrong_start_and_end_in_peace(self) -> None:
        processes = {}
        for node in (DETECTOR, AVOIDER, CONTROLLER, VISUALIZER):
            set_parameters('right', node)
            call = [program(node), '__ns:=right']
            processes[node] = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            self.addCleanup(processes[node].kill)
        for node in processes:
            wait_for(lambda name='/right/' + node: name in publishers_of('/diagnostics'), START, node + ' at work')
        commands = Inbox('/right/%s/car_cmd' % CONTROLLER, Twist2DStamped)
        poses = publisher('/right/%s/lane_pose' % CONTROLLER, LanePose)
        controls = publisher('/right/%s/lane_control' % CONTROLLER, LaneControl)

        def drive() -> None:
            poses.publish(LanePose(header=Header(stamp=rospy.Time.now())))
            controls.publish(LaneControl(state=LaneControl.CLEAR))

        with Repeating(drive):
            commands.wait(lambda msg: msg.v > 0, 'driving')
            for process in processes.values():
                process.send_signal(signal.SIGINT)
            wait_for(lambda: all(process.poll() is not None for process in processes.values()), LIMIT, 'the end of all')
        for node, process in processes.items():
            output = process.communicate(timeout=LIMIT)[0].decode(errors='replace')
            self.assertNotIn('Traceback', output, node)
            self.assertEqual(process.returncode, 0, '%s: %s' % (node, output))
        self.assertEqual(commands.all()[-1].v, 0, 'wheels go on with the last command that they got')


@functools.lru_cache(maxsize=None)
def program(node: str) -> str:
    """The file that roslaunch would start. Not rosrun, whose shell sets PWD anew."""
    return str(find_node('obst_avoid', node)[0])


def set_parameters(namespace: str, node: str) -> None:
    """Give a node under some namespace what replay.launch gives it."""
    launched = load_launch(
        'replay.launch', veh='right', bag='/right.bag', allow_default_calibration='true', msgs_package='obst_avoid'
    )
    own = '/right/%s/' % node
    for name, param in launched.params.items():
        if name.startswith(own):
            rospy.set_param('/%s/%s/%s' % (namespace, node, name[len(own) :]), param.value)


def add_cases() -> None:
    """A test for each case, so that each has its line in the report."""
    for name in CASES:
        setattr(StartErrors, 'test_' + name, lambda self, name=name: self.check(name))


add_cases()

if __name__ == '__main__':
    rospy.init_node('start_errors')
    rostest.rosrun('obst_avoid', 'start_errors', StartErrors, sys.argv)
