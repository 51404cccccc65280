#!/usr/bin/env python3
"""The lane controller with a simulated robot and LaneControl that is published by hand, on wall time."""

import math
import sys
import threading
import time
import unittest
from typing import Optional

import rospy
import rostest
from helpers import ANSWER, Diagnostics, Inbox, Repeating, nanoseconds, publisher, wait_for
from std_msgs.msg import Header

from obst_avoid.msg import LaneControl, LanePose, Twist2DStamped

NODE = '/duck1/lane_controller_node'
CLEAR = LaneControl(state=LaneControl.CLEAR, active=False, v_ref=0.2)
STOPPED = LaneControl(state=LaneControl.STOPPED, active=True, v_ref=0.0)
CRUISE = 0.2
"""[m/s] of config/lane_controller_node.yaml."""
LATEST = 1.0
"""[s] after which the wheels must stand when an input has stopped; the limit is 0.4 s, the machine may be busy."""


def avoiding(d_ref: float, v_ref: float = 0.12) -> LaneControl:
    return LaneControl(state=LaneControl.AVOIDING, active=True, d_ref=d_ref, v_ref=v_ref)


class Robot:
    """A simulated one in its lane. It does as it is told, at once, and says where it is."""

    def __init__(self, d: float = 0.0, phi: float = 0.0, curvature: float = 0.0) -> None:
        self.d, self.phi, self.curvature = d, phi, curvature
        self._time = time.monotonic()

    def moved(self, command: Twist2DStamped) -> LanePose:
        """Where it is now, after the command since the last call."""
        seconds, self._time = time.monotonic() - self._time, time.monotonic()
        along = command.v * seconds
        self.d += along * math.sin(self.phi)
        self.phi += command.omega * seconds - self.curvature * along
        return LanePose(header=Header(stamp=rospy.Time.now()), d=self.d, phi=self.phi, curvature=self.curvature)


class Controller(unittest.TestCase):
    def setUp(self) -> None:
        cls = type(self)
        if not hasattr(cls, 'commands'):
            cls.commands = Inbox(NODE + '/car_cmd', Twist2DStamped).connected()
            cls.diagnostics = Diagnostics()
            cls.pose_publisher = publisher('/duck1/lane_filter_node/lane_pose', LanePose)
            cls.control_publisher = publisher('/duck1/obstacle_avoidance_node/lane_control', LaneControl)
        self.lock = threading.Lock()
        self.told(CLEAR, Robot())
        feeding = Repeating(self.publish)
        feeding.__enter__()
        self.addCleanup(feeding.__exit__)
        self.comes_to(0.0, CRUISE)

    def publish(self) -> None:
        commands = self.commands.all()
        with self.lock:
            if self.robot is not None:
                pose = self.robot.moved(commands[-1] if commands else Twist2DStamped())
                self.pose_publisher.publish(pose)
            if self.control is not None:
                self.control_publisher.publish(self.control)

    def told(self, control: Optional[LaneControl], robot: Optional[Robot]) -> int:
        """From now on. Returns the time [ns] before which the old was published."""
        with self.lock:
            self.control, self.robot = control, robot
            return int(rospy.Time.now().to_nsec())

    def turns(self, robot: Robot, omega: float, control: LaneControl = CLEAR) -> None:
        """Soon, once the robot is found where it was put."""
        since = self.told(control, robot)
        self.commands.wait(
            lambda msg: nanoseconds(msg) > since and (msg.omega > omega > 0 or msg.omega < omega < 0), 'turning'
        )

    def comes_to(self, d: float, v: float, omega: float = 0.0) -> None:
        """The robot drives there, and stays."""
        robot = self.robot
        wait_for(lambda: abs(robot.d - d) < 0.01 and abs(robot.phi) < 0.05, ANSWER, 'd = %.2f m' % d)
        time.sleep(0.5)
        self.assertAlmostEqual(robot.d, d, delta=0.02)
        msg = self.commands.all()[-1]
        self.assertAlmostEqual(msg.v, v, places=6)
        self.assertAlmostEqual(msg.omega, omega, delta=0.3)

    def test_follows_the_lane_when_nothing_is_asked(self) -> None:
        self.told(CLEAR, Robot(d=0.02))
        self.comes_to(0.0, CRUISE)

    def test_left_of_the_centre_turns_right(self) -> None:
        self.turns(Robot(d=0.08), -0.06)
        self.comes_to(0.0, CRUISE)

    def test_right_of_the_centre_turns_left(self) -> None:
        self.turns(Robot(d=-0.08), 0.06)
        self.comes_to(0.0, CRUISE)

    def test_turned_left_turns_right(self) -> None:
        self.turns(Robot(phi=0.5), -0.1)
        self.comes_to(0.0, CRUISE)

    def test_a_lane_that_bends_left_turns_left(self) -> None:
        self.turns(Robot(curvature=2.0), 0.1)
        self.comes_to(0.0, CRUISE, CRUISE * 2.0)

    def test_tracks_offset_and_speed_when_active(self) -> None:
        self.turns(self.robot, 0.05, avoiding(0.03))
        self.comes_to(0.03, 0.12)
        self.turns(self.robot, -0.05, avoiding(-0.03))
        self.comes_to(-0.03, 0.12)

    def test_an_offset_counts_only_when_active(self) -> None:
        self.told(LaneControl(state=LaneControl.CLEAR, active=False, d_ref=0.03, v_ref=0.05), self.robot)
        self.comes_to(0.0, CRUISE)

    def test_stands_when_asked_to(self) -> None:
        since = self.told(STOPPED, Robot(d=0.05, phi=0.3))
        msg = self.commands.wait(lambda msg: nanoseconds(msg) > since + 3 * 10**8, 'a command 0.3 s later')
        self.assertEqual((msg.v, msg.omega), (0.0, 0.0))
        self.diagnostics.wait(NODE, lambda line: 'asked to' in line.message, 'why it stands')

    def stands_after(self, since: int, words: str) -> None:
        """Soon the command is to stand, and it stays so."""
        first = self.commands.wait(lambda msg: nanoseconds(msg) > since and msg.v == 0, 'standing')
        self.assertLess((nanoseconds(first) - since) / 1e9, LATEST)
        later = self.commands.wait(lambda msg: nanoseconds(msg) > nanoseconds(first) + 10**9, 'a second later')
        after = [msg for msg in self.commands.all() if nanoseconds(first) <= nanoseconds(msg) <= nanoseconds(later)]
        self.assertEqual({(msg.v, msg.omega) for msg in after}, {(0.0, 0.0)})
        self.assertGreaterEqual(len(after), 5, 'wheels go on with the last command that they got')
        self.diagnostics.wait(NODE, lambda line: words in line.message, words)

    def test_stands_when_lane_poses_stop(self) -> None:
        since = self.told(CLEAR, None)
        self.stands_after(since, 'the lane pose is')

    def test_stands_when_lane_control_stops(self) -> None:
        self.stands_after(self.told(None, Robot(d=0.05)), 'the lane control is')

    def test_stands_when_both_stop(self) -> None:
        since = self.told(None, None)
        self.stands_after(since, 'is')  # said by its timer alone

    def test_a_lane_pose_of_nan_is_not_used(self) -> None:
        since = self.told(CLEAR, Robot(d=math.nan))
        self.stands_after(since, 'the lane pose is')

    def test_a_lane_control_that_contradicts_itself_is_not_used(self) -> None:
        self.stands_after(
            self.told(LaneControl(state=LaneControl.AVOIDING, active=False, v_ref=0.1), Robot()), 'the lane control'
        )


if __name__ == '__main__':
    rospy.init_node('lane_controller')
    rostest.rosrun('obst_avoid', 'lane_controller', Controller, sys.argv)
