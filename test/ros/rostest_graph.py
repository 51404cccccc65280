#!/usr/bin/env python3
"""The simulated drive through the whole graph: stop before the duckie, release when it is gone, pass the one beside."""

import itertools
import json
import os
import sys
import tempfile
from typing import Any, Dict, List, Tuple

import cv2
import rospy
import rostest
from helpers import Inbox, Prepared, nanoseconds, run_program

from obst_avoid.msg import BoolStamped, LaneControl, Twist2DStamped
from obst_avoid.offline.simulated_bag import PICTURES

NAMES = {0: 'CLEAR', 1: 'SLOWING', 2: 'AVOIDING', 3: 'STOPPED', 4: 'FAULT'}
REACTION = 0.4
"""[s] of ROS time that controller and network may take, before the wheels stand or drive again."""


class Graph(Prepared):
    controls: List[LaneControl]
    flags: List[BoolStamped]
    commands: List[Twist2DStamped]
    output: str
    log: str

    @classmethod
    def prepare(cls) -> None:
        # Another name than in the bag: the recording is played under the robot's name that is asked for.
        control = Inbox('/town/obstacle_avoidance_node/lane_control', LaneControl)
        flag = Inbox('/town/obstacle_avoidance_node/obstacle_avoidance_active_flag', BoolStamped)
        command = Inbox('/town/lane_controller_node/car_cmd', Twist2DStamped)
        folder = tempfile.mkdtemp(prefix='obst_avoid_')
        cls.output = os.path.join(folder, 'result')
        arguments = {
            'bag': rospy.get_param('~bag'),
            'veh': 'town',
            'allow_default_calibration': 'true',
            'msgs_package': 'obst_avoid',
            'output': 'result',  # seen from where roslaunch is called, not from where nodes run
        }
        call = ['roslaunch', 'obst_avoid', 'replay.launch', *('%s:=%s' % item for item in arguments.items())]
        ended = run_program(call, 200, {'PWD': folder})
        cls.log = ended.output
        cls.controls, cls.flags, cls.commands = control.all(), flag.all(), command.all()

    def states(self) -> List[Tuple[str, int, int]]:
        """(name, stamp of the first, stamp of the last) of each stretch, faults left out."""
        seen = [(NAMES[msg.state], nanoseconds(msg)) for msg in self.controls if msg.state != LaneControl.FAULT]
        stretches = []
        for name, group in itertools.groupby(seen, key=lambda item: item[0]):
            stamps = [stamp for _, stamp in group]
            stretches.append((name, stamps[0], stamps[-1]))
        return stretches

    def summary(self) -> Dict[str, Any]:
        path = os.path.join(self.output, 'summary.json')
        self.assertTrue(os.path.exists(path), self.log[-3000:])
        with open(path, encoding='utf-8') as file:
            content: Dict[str, Any] = json.load(file)
        return content

    def said(self, *marks: str) -> List[str]:
        """Lines of roslaunch's output with one of the marks."""
        return [line for line in self.log.splitlines() if any(mark in line for mark in marks)]

    def test_it_ran_to_the_end(self) -> None:
        self.assertEqual(len(self.said('the recording is over')), 1, self.log[-3000:])

    def test_no_node_breaks_while_it_runs_or_ends(self) -> None:
        self.assertEqual(self.said('Traceback', '[FATAL]', '[ERROR]'), [], self.log[-3000:])

    def test_each_node_ends_with_success(self) -> None:
        self.assertEqual(self.said('exit code'), [])

    def test_it_stops_is_released_and_passes(self) -> None:
        names = [name for name, _, _ in self.states() if name in ('CLEAR', 'STOPPED', 'AVOIDING')]
        self.assertIn('STOPPED', names, names)
        after = names[names.index('STOPPED') :]
        self.assertIn('CLEAR', after, names)
        self.assertIn('AVOIDING', after[after.index('CLEAR') :], names)

    def test_it_passes_at_the_left(self) -> None:
        offsets = [msg.d_ref for msg in self.controls if msg.state == LaneControl.AVOIDING]
        self.assertTrue(offsets and min(offsets) > 0 and max(offsets) < 0.036, offsets)

    def test_before_the_first_picture_it_says_so(self) -> None:
        early = [msg for msg in self.controls if not nanoseconds(msg)]
        self.assertGreaterEqual(len(early), 1)
        self.assertEqual({(msg.state, msg.v_ref) for msg in early}, {(LaneControl.FAULT, 0.0)})

    def test_hardly_any_fault_after_that(self) -> None:
        answered = [msg for msg in self.controls if nanoseconds(msg)]
        faults = [msg.reason for msg in answered if msg.state == LaneControl.FAULT]
        faults = [reason for reason in faults if not reason.startswith('waiting')]  # the first second is waited out
        self.assertLess(len(faults), len(answered) / 10, faults[:5])

    def test_the_flag_says_what_lane_control_says(self) -> None:
        said: Dict[int, set] = {}
        for msg in self.controls:
            said.setdefault(nanoseconds(msg), set()).add(bool(msg.active))
        flagged: Dict[int, set] = {}
        for msg in self.flags:
            flagged.setdefault(nanoseconds(msg), set()).add(bool(msg.data))
        # A stamp that was answered twice, differently, says nothing: either message may have been lost.
        both = [stamp for stamp in said if len(said[stamp]) == 1 and len(flagged.get(stamp, ())) == 1]
        self.assertGreaterEqual(len(both), PICTURES / 2)
        self.assertEqual([stamp for stamp in both if said[stamp] != flagged[stamp]], [])
        self.assertEqual({value for stamp in both for value in said[stamp]}, {True, False})

    def test_the_wheels_stand_while_it_is_stopped_and_turn_after_the_release(self) -> None:
        states = [stretch for stretch in self.states() if stretch[0] in ('CLEAR', 'STOPPED')]
        at = next(i for i, stretch in enumerate(states) if stretch[0] == 'STOPPED' and stretch[2] > stretch[1] + 10**9)
        _, first, last = states[at]
        late = int(REACTION * 1e9)
        standing = [msg.v for msg in self.commands if first + late < nanoseconds(msg) < last]
        self.assertGreaterEqual(len(standing), 10)
        self.assertEqual(set(standing), {0.0})
        released, last = states[at][2], max(nanoseconds(msg) for msg in self.controls)
        driving = [
            msg.v for msg in self.commands if released + late < nanoseconds(msg) < last
        ]  # past the next one, too
        self.assertGreaterEqual(len(driving), 10)
        self.assertGreater(sorted(driving)[len(driving) // 2], 0.1)
        before = [msg.v for msg in self.commands if nanoseconds(msg) < states[at][1]]
        self.assertGreater(max(before), 0.1)

    def test_the_summary_counts_it(self) -> None:
        summary = self.summary()
        self.assertEqual(summary['pictures'], PICTURES)
        self.assertGreaterEqual(summary['pictures_answered'], PICTURES - 5)
        self.assertEqual(summary['pictures_skipped'], PICTURES - summary['pictures_answered'])
        self.assertGreaterEqual(summary['stops'], 1)
        self.assertGreaterEqual(summary['releases'], 1)
        self.assertGreaterEqual(summary['activations'], 2)
        self.assertGreater(summary['obstacles_inside'], 100)
        self.assertGreater(summary['obstacles_outside'], 20)
        self.assertGreater(summary['median_latency_ms'], 0)

    def test_the_contact_sheet_is_a_picture(self) -> None:
        sheet = cv2.imread(os.path.join(self.output, 'contact_sheet.png'))
        self.assertIsNotNone(sheet, sorted(os.listdir(self.output)))
        self.assertGreater(min(sheet.shape[:2]), 400)


if __name__ == '__main__':
    rospy.init_node('graph')
    rostest.rosrun('obst_avoid', 'graph', Graph, sys.argv)
